"""A bench of another hand: a hybrid pair under PID by Runge-Kutta steps, with sensor noise, converters and a delay.

It shares no formula with the simulator: fields of both gaps are evaluated one by one, and the amplifier and the probe
are advanced over tenths of a control step.
"""

from dataclasses import dataclass
from pathlib import Path

import numba as nb
import numpy as np
from scipy import signal

MU_0 = 4e-7 * np.pi
RATE, STEPS = 20_000.0, 10  # Hz, and integration steps in a control step
MASS, GAP, TURNS, POLE, BIAS, BEARINGS = 0.08012, 0.35e-3, 90.0, 39.27e-6, 0.2, 2
REMANENCE, LENGTH, MAGNET_AREA, RECOIL = 0.7, 5e-3, 34.715e-6, 1.05 * MU_0
GAIN, STIFFNESS = 5.7, -12.5e3  # N/A and N/m, measured
KP, KI, KD, TD, TI = 8000.0, 2000.0, 5.2, 1e-4, 0.0318
T_AMPLIFIER, T_PROBE = 1e-4, 1.6e-5
ADC, DAC = 20 / 2**16 / 8000.0, 20 / 2**14  # m and A a count


@dataclass(frozen=True)
class Bench:
    """What of the bench differs from its data sheet: relative changes of gain and stiffness, a delay in s, and
    the half width of a dead band before the amplifier, A. The probe reads a tone of `tone` m at `tone_frequency` Hz,
    and follows the rotor behind a play of half the width `play`, m."""

    gain: float = 0.0
    stiffness: float = 0.0
    delay: float = 0.0
    band: float = 0.0
    noise: float = 1e-6  # of the probe, m rms
    current_noise: float = 2e-3  # A rms
    tone: float = 0.0
    tone_frequency: float = 61.7
    play: float = 0.0


def excitation(kind: str, seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Injection (A) and reference (m), (samples,) each: "noise", "chirp", "steps", "sine" or "hover"."""
    n = int(seconds * RATE)
    t, nothing = np.arange(n) / RATE, np.zeros(n)
    if kind == "noise":
        return 0.2 * signal.lfilter(*signal.butter(2, 1000.0, fs=RATE), rng.normal(size=n)), nothing
    if kind == "chirp":
        return 0.1 * signal.chirp(t, 2.0, seconds, 400.0, "logarithmic", -90), nothing
    if kind == "sine":
        return 0.1 * np.sin(2 * np.pi * 20.0 * t), nothing
    if kind == "steps":
        levels = rng.uniform(-2e-5, 2e-5, max(2, int(4 * seconds)))
        return nothing, np.repeat(levels, -(-n // levels.size))[:n]
    return nothing, nothing


def record(bench: Bench, kind: str, seconds: float, seed: int) -> dict[str, np.ndarray]:
    """Displacement (m), command (A) and current (A) of one run."""
    rng = np.random.default_rng(seed)
    injection, reference = excitation(kind, seconds, rng)
    n = injection.size
    noise = bench.noise * rng.normal(size=n), bench.current_noise * rng.normal(size=n)
    noise[0][:] += bench.tone * np.sin(2 * np.pi * bench.tone_frequency * np.arange(n) / RATE)
    h = 1e-9

    def slope(force, at):
        return (force(at) - force(-at)) / (2 * at)

    a = GAIN * (1 + bench.gain) / slope(lambda i: _pull(0.0, i), h)
    b = STIFFNESS * (1 + bench.stiffness) / -slope(lambda y: _pull(y, 0.0), h)
    late = round(bench.delay * RATE * STEPS)
    y, u, i = _run(injection, reference, *noise, a, b, late, bench.band, bench.play)
    return {"displacement": y, "command": u, "current": i}


def write_campaign(folder: Path, bench: Bench, kinds: dict[str, str], seconds: float, seed: int) -> Path:
    """A campaign of npz files, one recording for each kind of excitation -> role; no excitation is stated."""
    text = ['schema = "maglev-campaign/1"', 'rig = "hmb_free"']
    for j, (kind, role) in enumerate(kinds.items()):
        np.savez(folder / f"{kind}.npz", **record(bench, kind.split("-")[0], seconds, seed + j))
        text += ["[[recording]]", f'file = "{kind}.npz"', f'role = "{role}"', f"sample_rate = {RATE}"]
        text += [f"gains = {{ kp = {KP}, ki = {KI}, kd = {KD}, td = {TD}, ti = {TI} }}"]
        text += ['excitation = { kind = "none" }', "[recording.channels]"]
        text += [f'{name} = {{ from = "{name}" }}' for name in ("displacement", "command", "current")]
    (folder / "campaign.toml").write_text("\n".join(text))
    return folder


@nb.njit(cache=True)
def _pull(y, i):
    """Force (N) of both bearings at displacement y (m) and control current i (A), not calibrated."""
    magnet, reluctance = REMANENCE * LENGTH / RECOIL, LENGTH * POLE / (RECOIL * MAGNET_AREA)
    up, down = GAP - y, GAP + y
    b_up = magnet / (2 * up / MU_0 + reluctance) + MU_0 * TURNS * (BIAS + i) / (2 * up)
    b_down = magnet / (2 * down / MU_0 + reluctance) + MU_0 * TURNS * (BIAS - i) / (2 * down)
    return BEARINGS * POLE / (2 * MU_0) * (b_up**2 - b_down**2)


@nb.njit(cache=True)
def _acceleration(y, i, a, b):
    return (_pull(y, a * i) + (b - 1.0) * _pull(y, 0.0)) / MASS


@nb.njit(cache=True)
def _run(injection, reference, noise, current_noise, a, b, late, band, play):
    n = injection.size
    out_y, out_u, out_i = np.empty(n), np.empty(n), np.empty(n)
    dt = 1.0 / RATE
    h = dt / STEPS
    y = v = current = probe = held = lag = leak = before = command = 0.0
    for k in range(n):
        held = min(max(held, probe - play), probe + play)
        reading = np.rint((held + noise[k]) / ADC) * ADC
        error = reference[k] - reading
        u = KP * error + KD * (error - lag) / TD + KI * leak + injection[k]
        lag, leak = error + (lag - error) * np.exp(-dt / TD), error + (leak - error) * np.exp(-dt / TI)
        before, command = command, np.rint(u / DAC) * DAC
        out_y[k], out_u[k], out_i[k] = reading, command, current + current_noise[k]
        for j in range(STEPS):
            u = before if j < late else command
            u = max(u - band, 0.0) + min(u + band, 0.0)
            half = u + (current - u) * np.exp(-0.5 * h / T_AMPLIFIER)
            end = u + (current - u) * np.exp(-h / T_AMPLIFIER)
            a1 = _acceleration(y, current, a, b)
            a2 = _acceleration(y + 0.5 * h * v, half, a, b)
            a3 = _acceleration(y + 0.5 * h * (v + 0.5 * h * a1), half, a, b)
            a4 = _acceleration(y + h * (v + 0.5 * h * a2), end, a, b)
            y_end = y + h * v + h * h * (a1 + a2 + a3) / 6.0
            v = v + h * (a1 + 2.0 * (a2 + a3) + a4) / 6.0
            middle = 0.5 * (y + y_end)
            probe = middle + (probe - middle) * np.exp(-h / T_PROBE)
            y, current = y_end, end
    return out_y, out_u, out_i
