"""What a hidden rig does at gains: the quantities of a goal, as docs/goals.md defines them, without a meter's noise."""

from dataclasses import replace

import numpy as np
import scipy
from draws import stiffness_of
from rigs import sent, waves

DRIVES = 6  # of random phases, whose mean is the response


def margins(hidden, gains, force, injection, lines):
    """Margins at the amplitude of a recording whose force and injection (n,) are given, at every half line.

    The force is as recorded; the injection is as strong at every frequency, but on the odd lines of twice the period,
    so that nothing falls between its lines. The mean of several such drives: what distortion adds to a line is another
    thing in each, and the largest of many lines would be the one that it raised most.
    """
    n = 2 * force.size
    at = np.arange(1, min(round(0.84 * force.size), 4400), 2)
    # Power per Hz as that of equal lines, which stand nearer or farther from each other.
    size = np.zeros(n // 2 + 1)
    size[at] = np.interp(at / 2, lines, 1 / np.sqrt(np.gradient(lines.astype(float))))
    rng, ratio = np.random.default_rng(0), np.zeros(at.size, complex)
    for _ in range(DRIVES):
        phase = np.zeros(n // 2 + 1)
        phase[at] = rng.uniform(0, 2 * np.pi, at.size)
        wave = np.fft.irfft(size * np.exp(1j * phase))
        wave *= injection.std() / wave.std()
        rows, _ = sent(hidden, gains, np.tile(force, 6), np.tile(wave, 3))
        ratio += np.fft.rfft(rows[1][-n:])[at] / np.fft.rfft(wave)[at] / DRIVES
    loop = 1 / ratio - 1
    # Straight between the half lines, sixteen points to each; below them the plant hardly changes.
    fine = np.arange(16 * (at.size - 1) + 1) / 16
    loop = np.interp(fine, np.arange(at.size), loop.real) + 1j * np.interp(fine, np.arange(at.size), loop.imag)
    first = at[0] / (n * hidden.dt)
    under = np.append(0.0, np.geomspace(0.01, 1.0, 200, endpoint=False)) * first
    mass_share = hidden.mass * (2 * np.pi) ** 2 / abs(stiffness_of(hidden))  # s^2: P falls with 1 + this f^2
    rest = (loop[0] / controller(gains, first, hidden.dt)).real * (1 + mass_share * first**2)
    loop = np.concatenate([controller(gains, under, hidden.dt) * rest / (1 + mass_share * under**2), loop])
    size, angle = np.abs(loop), np.angle(-loop)
    unit = np.flatnonzero(np.diff(np.sign(size - 1)))
    real = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0) & (loop.real[:-1] < 0))
    return {
        "peak_sensitivity": float(np.abs(1 / (1 + loop)).max()),
        "phase_margin": float(np.degrees(min(abs(angle[unit]), default=np.pi))),
        "gain_margin": float(min([size[0], *(max(size[k], 1 / size[k]) for k in real)])),
        "disk_margin": float(1 / np.abs(1 / (1 + loop) - 0.5).max()),
    }


def controller(gains, frequency, dt):
    """Response of the recursion of `rigs.run` from error to command."""
    z = np.exp(2j * np.pi * np.asarray(frequency) * dt)
    low, held = ((1 - np.exp(-dt / gains[t])) / (z - np.exp(-dt / gains[t])) for t in ("td", "ti"))
    return gains["kp"] + gains["kd"] / gains["td"] * (1 - low) + gains["ki"] * held


def truth(hidden, gains, block, goal, rng):
    """What the hidden rig does at gains: values of the goal's quantities by name."""
    force, injection, lines = waves(block, hidden)
    n, push = force.size, lines["force"]
    rows, _ = sent(hidden, gains, np.tile(force, 4), np.tile(injection, 4))
    driven = np.fft.rfft(rows[3][-n:])
    hold = np.sinc(push / n)  # the force is held for a tick
    found = margins(hidden, gains, force, injection, lines["current"])
    found["compliance"] = float(np.abs(driven[push] / np.fft.rfft(force)[push] / hold).max())
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
