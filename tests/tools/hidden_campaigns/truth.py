"""What a hidden rig does at gains: the quantities of a goal, as docs/goals.md defines them, without a meter's noise."""

from dataclasses import replace

import numpy as np
import scipy
from rigs import sent, waves


def truth(hidden, gains, block, goal, rng):
    """What the hidden rig does at gains: values of the goal's quantities by name."""
    force, injection, lines = waves(block, hidden)
    n = force.size
    rows, _ = sent(hidden, gains, np.tile(force, 4), np.tile(injection, 4))
    driven = np.fft.rfft(rows[3][-n:])
    # Margins at every line, so that none falls between them; as strong as the recording was.
    at = np.arange(lines["current"][0], round(0.42 * n) if n < 6000 else 2200)
    phase = np.random.default_rng(0).uniform(0, 2 * np.pi, at.size)
    wave = np.fft.irfft(
        np.bincount(at, minlength=n // 2 + 1) * np.exp(1j * np.interp(np.arange(n // 2 + 1), at, phase))
    )
    wave *= injection.std() / wave.std()
    rows, _ = sent(hidden, gains, np.zeros(4 * wave.size), np.tile(wave, 4))
    loop = np.fft.rfft(wave)[at] / np.fft.rfft(rows[1][-wave.size :])[at] - 1
    size, angle = np.abs(loop), np.angle(-loop)
    unit = np.flatnonzero(np.diff(np.sign(size - 1)))
    real = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0) & (loop.real[:-1] < 0))
    factors = [max(size[k], 1 / size[k]) for k in real] + [size[0]]
    push = lines["force"]
    hold = np.sinc(push / n)  # the force is held for a tick
    found = {
        "peak_sensitivity": float(np.abs(1 / (1 + loop)).max()),
        "phase_margin": float(np.degrees(min(abs(angle[unit]), default=np.pi))),
        "gain_margin": float(min(factors)),
        "disk_margin": float(1 / np.abs(1 / (1 + loop) - 0.5).max()),
        "compliance": float(np.abs(driven[push] / np.fft.rfft(force)[push] / hold).max()),
    }
    still = np.zeros(round(2.0 / hidden.dt))
    hidden = replace(hidden, noise=(hidden.noise[0], 0.0, 0.0))  # of the current itself, not of its meter
    hover, _ = sent(hidden, gains, still, still, rng)
    found["noise_current"] = float(hover[2][still.size // 4 :].std())
    middle = hover[0][still.size // 4 :].mean()
    for r in goal.measured:
        kind = r.quantity.event
        if kind not in ("impulse", "step", "lift_off"):
            continue
        span = round((0.5 if kind == "impulse" else 3 * r.limit) / hidden.dt)
        push, quiet = np.zeros(span), round(0.5 / hidden.dt)
        if kind == "impulse":
            push[0] = r.size / hidden.dt
        if kind == "step":
            push[:] = r.size
        push = push if kind == "lift_off" else np.concatenate([np.zeros(quiet), push])
        lying = {"start": r.size if hidden.law == 0 else -r.size, "held": 100} if kind == "lift_off" else {}
        rows, down = sent(hidden, gains, push, np.zeros(push.size), rng, **lying)
        y = rows[0][push.size - span :] - middle
        if kind == "impulse":
            found[r.name] = np.inf if down else float(np.abs(y).max())
            continue
        width = max(1, round(r.limit / 30 / hidden.dt))
        calm = scipy.ndimage.uniform_filter1d(hover[0][still.size // 4 :] - middle, width).std()
        y = scipy.ndimage.uniform_filter1d(y, width, mode="nearest")
        end = y[-max(1, int(0.2 * y.size)) :].mean()
        near = max(0.1 * np.abs(y).max(), 0.01 * hidden.clearance, 5 * calm)
        out = np.flatnonzero(np.abs(y - end) > near)
        found[r.name] = np.inf if down else float((out[-1] + 1) * hidden.dt) if out.size else 0.0
    return found
