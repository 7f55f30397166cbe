"""What drives an experiment: periodic multisines at the force, the current or the reference."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from typing import Literal

import numpy as np

from estimation.sphs import Multisine, random_phase, sphs, synthesise

KINDS = ("sphs", "multisine", "recorded", "none")
PLACES = ("force", "current", "reference")
UNITS = {"force": "N", "current": "A", "reference": "m"}


@dataclass(frozen=True)
class Excitation:
    """One periodic excitation; several of them on different lines may share a record.

    kind: "sphs" (Schroeder phases, D App. A) or "multisine" (random phases drawn from `seed`).
    at: "force" (N, on the rotor), "current" (A, added to the command) or "reference" (m).
    fundamental in Hz; lines are harmonic numbers; amplitude is the peak of the period, in the unit of `at`. direction:
    degrees from x toward y in which it acts on an x-y rig.
    "recorded" and "none" describe recordings that no multisine drives; they cannot be synthesised.
    """

    kind: Literal["sphs", "multisine", "recorded", "none"]
    at: Literal["force", "current", "reference"] = "force"
    fundamental: float = 1.0
    lines: tuple[int, ...] = ()
    amplitude: float = 1.0
    seed: int = 0
    direction: float = 0.0

    def __post_init__(self) -> None:
        if not isfinite(self.direction):
            raise ValueError(f"excitation: direction = {self.direction} must be a number of degrees")
        if self.kind not in KINDS:
            raise ValueError(f"excitation: kind = {self.kind!r}; use one of {', '.join(KINDS)}")
        if self.at not in PLACES:
            raise ValueError(f"excitation: at = {self.at!r}; use one of {', '.join(PLACES)}")
        if self.kind in ("recorded", "none"):
            return
        if not self.fundamental > 0:
            raise ValueError(f"excitation: fundamental = {self.fundamental} Hz must be positive")
        lines = self.lines
        if not lines or any(b <= a for a, b in pairwise(lines)) or lines[0] < 1:
            raise ValueError("excitation: lines must be strictly increasing harmonic numbers, the first at least 1")
        if not (isfinite(self.amplitude) and self.amplitude > 0):
            raise ValueError(f"excitation: amplitude = {self.amplitude} {UNITS[self.at]} must be positive")

    @property
    def periodic(self) -> bool:
        return self.kind in ("sphs", "multisine")

    @property
    def frequencies(self) -> np.ndarray:
        """Excited frequencies, Hz, shape (lines,)."""
        return np.asarray(self.lines, dtype=float) * self.fundamental

    @property
    def components(self) -> np.ndarray:
        """Shares in x and y, shape (2,): cosine and sine of the direction, exact in multiples of 90 degrees."""
        angle = np.deg2rad(self.direction)
        shares = np.array([np.cos(angle), np.sin(angle)])
        return np.where(np.abs(shares) < 1e-12, 0.0, shares)

    def samples_per_period(self, sample_rate: float) -> int:
        """Samples in one period; ValueError when the period is not a whole number of them."""
        n = sample_rate / self.fundamental
        if abs(n - round(n)) > 1e-6 * n:
            raise ValueError(
                f"excitation: fundamental {self.fundamental} Hz does not divide the rate {sample_rate} Hz: "
                f"a period would be {n:.6g} samples; choose a fundamental that gives a whole number"
            )
        return round(n)

    def multisine(self, sample_rate: float) -> Multisine:
        """The designed multisine on the sample grid of `sample_rate` (Hz)."""
        n = self.samples_per_period(sample_rate)
        if 2 * self.lines[-1] >= n:
            raise ValueError(
                f"excitation: line {self.lines[-1]} ({self.frequencies[-1]:g} Hz) is not below half of {sample_rate} Hz"
            )
        if self.kind == "sphs":
            return sphs(self.lines, n, peak=self.amplitude)
        return random_phase(self.lines, n, self.seed, peak=self.amplitude)

    def waveform(self, sample_rate: float) -> np.ndarray:
        """One period, shape (samples_per_period,), in the unit of `at`."""
        return synthesise(self.multisine(sample_rate), self.samples_per_period(sample_rate))


def parse_lines(text: str) -> tuple[int, ...]:
    """Harmonics from `first:last` or `first:last:step`; ValueError when it is not that."""
    try:
        first, last, *step = (int(part) for part in text.split(":"))
        lines = tuple(range(first, last + 1, *step))
    except (ValueError, TypeError):
        raise ValueError(f"lines {text!r}: write first:last or first:last:step, whole numbers") from None
    if not lines or first < 1:
        raise ValueError(f"lines {text!r} hold no harmonic from 1 up")
    return lines


def parse_excitation(text: str, fundamental: float) -> Excitation:
    """A Schroeder multisine from `place=lines@peak`, e.g. `force=1:249:2@0.4` (N), `current=2:200:2@0.1` (A)."""
    place, equals, rest = text.partition("=")
    lines, at, peak = rest.partition("@")
    if not (equals and at):
        raise ValueError(f"excitation {text!r}: write place=first:last:step@peak, e.g. force=1:250@0.4")
    try:
        amplitude = float(peak)
    except ValueError:
        raise ValueError(f"excitation {text!r}: the peak {peak!r} is not a number") from None
    return Excitation("sphs", place.strip(), fundamental, parse_lines(lines), amplitude)


def lines_at(excitations: Iterable[Excitation], place: str | None = None) -> np.ndarray:
    """Sorted harmonic numbers that periodic excitations drive at "force", "current" or "reference" (None: anywhere)."""
    lines = [e.lines for e in excitations if e.periodic and place in (None, e.at)]
    return np.unique(np.concatenate(lines)) if lines else np.zeros(0, int)


def check_interleaved(excitations: tuple[Excitation, ...]) -> None:
    """Raise ValueError unless the periodic excitations share a fundamental and no line."""
    taken: dict[int, str] = {}
    fundamentals = {e.fundamental for e in excitations if e.periodic}
    if len(fundamentals) > 1:
        raise ValueError(f"excitation: fundamentals {sorted(fundamentals)} differ; one record needs one period")
    for e in excitations:
        for line in e.lines:
            if line in taken:
                raise ValueError(
                    f"excitation: line {line} is excited at both {taken[line]} and {e.at}; interleave the lines"
                )
            taken[line] = e.at
