"""What drives a recording: periodic multisines, chirps, noise and steps, at the force, the command or the reference."""

from dataclasses import dataclass
from math import pi

import numpy as np
from scipy.signal import butter, sosfilt

from sim2real.blind.benchmark.rigs import SHAKEN, BenchRig

PERIODIC = 6  # periods of a multisine, the first of which settles
SECONDS = 0.25  # duration of one on rigs of 100 rad/s and above
BOTH = 45.0  # degrees: along both axes alike
CHANNEL = {"force": "force", "current": "injection", "reference": "reference"}  # of each place


@dataclass(frozen=True)
class Drive:
    """One waveform at one place.

    Attributes:
        shape: "multisine", "chirp", "noise", "steps" or "hover".
        at: "force" (N), "current" (A) or "reference" (m).
        wave: Samples at the control rate (n,).
        lines: Driven harmonics of a multisine.
        fundamental: Of a multisine, Hz.
        direction: Of two axes, degrees from x toward y.
        periods: Of a multisine, in the waveform.
    """

    shape: str
    at: str
    wave: np.ndarray
    lines: tuple[int, ...] = ()
    fundamental: float = 0.0
    direction: float = 0.0
    periods: int = PERIODIC

    def channels(self, axes: int) -> dict[str, np.ndarray]:
        """The channels force, injection and reference (n, axes)."""
        turn = np.deg2rad(self.direction)
        along = np.array([1.0] if axes == 1 else [np.cos(turn), np.sin(turn)])
        none = np.zeros((self.wave.size, axes))
        return {name: self.wave[:, None] * along if self.at == place else none for place, name in CHANNEL.items()}


def draw_drive(shape: str, rig: BenchRig, forced: bool, level: float, rng: np.random.Generator) -> Drive:
    """A drive of a shape that moves the rotor by about `level` gaps (peak).

    Args:
        shape: Its shape.
        rig: The rig, whose bandwidth sets the frequencies.
        forced: Whether a force may be applied and is recorded.
        level: In gaps.
        rng: Draws lines, phases and places.
    """
    places = ["current", *(["force", "force"] if forced and rig.family in SHAKEN else [])]
    if rig.family == "ball" or shape == "steps":
        places = ["reference"] if shape == "steps" else ["current", "reference"]
    place = str(rng.choice(places))
    rate, top = rig.parameters["control_rate"], rig.bandwidth / (2 * pi)
    direction = float(rng.choice([0.0, 90.0, BOTH])) if rig.axes == 2 else 0.0
    period = round(SECONDS * max(1.0, 100.0 / rig.bandwidth) * rate)
    seconds = 5 * period / rate
    lines: tuple[int, ...] = ()
    fundamental = 0.0
    if shape == "multisine":
        fundamental = rate / period
        odd = np.arange(1, max(12, round(2.5 * top / fundamental)), 2)
        lines = tuple(int(n) for n in odd[rng.random(odd.size) < 0.8])
        t = np.arange(period) / period
        wave = sum(np.cos(2 * pi * (n * t + rng.random())) for n in lines)
        wave = np.tile(wave, PERIODIC)
    elif shape == "chirp":
        t = np.arange(5 * period) / rate
        low = 0.1 * top
        growth = np.log(2.5 * top / low)
        wave = np.sin(2 * pi * low * seconds / growth * (np.exp(t / seconds * growth) - 1))
    elif shape == "noise":
        wave = sosfilt(butter(4, 2 * top, fs=rate, output="sos"), rng.standard_normal(5 * period))
    elif shape == "steps":
        hold = round(rate * 8 * pi / rig.bandwidth)
        levels = rng.uniform(-1, 1, 5 * period // hold + 1)
        levels[0] = 0.0
        rise = np.hanning(round(6 * rate / rig.bandwidth) + 2)  # set points move smoothly
        wave = np.convolve(np.repeat(levels, hold), rise / rise.sum())[: 5 * period]
    else:
        wave = np.zeros(2 * period)
    if np.abs(wave).max() > 0:
        wave = wave / np.abs(wave).max() * level * _unit(rig, place)
    return Drive(shape, place, wave, lines, fundamental, direction)


def _unit(rig: BenchRig, place: str) -> float:
    """Amplitude at a place that moves the rotor by about one gap."""
    p = rig.parameters
    if place == "reference":
        return p["gap"]
    force = p["mass"] * rig.bandwidth**2 * p["gap"]
    return force if place == "force" else force / rig.gain
