"""Excitations of an experiment: periodic multisines at the force, the current or the reference."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from estimation.multisine.low_crest import low_crest
from estimation.multisine.sphs import Multisine, impulse, random_phase, sphs, synthesise
from maglev_env.channels import SHOWN_BY, Place, unit_of
from maglev_env.fields import is_number

KINDS = ("sphs", "multisine", "low_crest", "impulse", "recorded", "none")
PLACES: tuple[Place, ...] = tuple(SHOWN_BY)
MAX_HARMONIC = 1_000_000
MOST_BLOCK = 1000  # periods in a block that is a whole number of samples
UNITS: Mapping[Place, str] = {place: unit_of(channel) for place, channel in SHOWN_BY.items()}


@dataclass(frozen=True)
class Excitation:
    """One periodic excitation; several of them on different lines may share a record.

    Args:
        kind: "sphs" (Schroeder phases, D App. A), "multisine" (random phases drawn from `seed`), "low_crest" (phases
            optimised for a low crest factor, see `estimation.multisine.low_crest`) or "impulse" (all lines in phase:
            one blow a period). "recorded" (another measured excitation) and "none" describe recordings; they cannot be
            synthesised.
        at: "force" (N, on the rotor), "current" (A, added to the command) or "reference" (m).
        fundamental: Hz.
        lines: harmonic numbers, increasing.
        amplitude: peak of the period, in the unit of `at`.
        seed: of random and optimised phases.
        direction: in which it acts on an x-y rig, degrees from x toward y.
        band: (low, high) in Hz, where a "recorded" excitation is used; None: where it has power.

    Raises:
        ValueError: A value is not valid; the message names it.
    """

    kind: Literal["sphs", "multisine", "low_crest", "impulse", "recorded", "none"]
    at: Place = "force"
    fundamental: float = 1.0
    lines: tuple[int, ...] = ()
    amplitude: float = 1.0
    seed: int = 0
    direction: float = 0.0
    band: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        units = {"fundamental": "Hz", "amplitude": UNITS.get(self.at, ""), "direction": "degrees"}
        for name, unit in units.items():
            if not is_number(getattr(self, name)):
                raise ValueError(f"excitation: {name} = {getattr(self, name)!r} must be a finite number of {unit}")
        if type(self.seed) is not int or self.seed < 0:
            raise ValueError(f"excitation: seed = {self.seed!r} must be a whole number, at least 0")
        check_harmonics(self.lines, "lines")
        if self.kind not in KINDS:
            raise ValueError(f"excitation: kind = {self.kind!r}; use one of {', '.join(KINDS)}")
        if self.at not in PLACES:
            raise ValueError(f"excitation: at = {self.at!r}; use one of {', '.join(PLACES)}")
        if self.band is not None and (self.kind != "recorded" or not 0 < self.band[0] < self.band[1]):
            raise ValueError(f"excitation: band = {self.band} Hz must be two increasing frequencies of a recorded one")
        if self.kind in ("recorded", "none"):
            return
        if not self.fundamental > 0:
            raise ValueError(f"excitation: fundamental = {self.fundamental} Hz must be positive")
        lines = self.lines
        if not lines or any(b <= a for a, b in pairwise(lines)) or lines[0] < 1:
            raise ValueError("excitation: lines must be strictly increasing harmonic numbers, the first at least 1")
        if not self.amplitude > 0:
            raise ValueError(f"excitation: amplitude = {self.amplitude} {UNITS[self.at]} must be positive")

    @property
    def periodic(self) -> bool:
        return self.kind in ("sphs", "multisine", "low_crest", "impulse")

    @property
    def frequencies(self) -> np.ndarray:
        """Excited frequencies, Hz, shape (lines,)."""
        return np.asarray(self.lines, dtype=float) * self.fundamental

    @property
    def components(self) -> np.ndarray:
        """Shares in x and y, shape (2,): cosine and sine of the direction, exact for multiples of 90 degrees."""
        angle = np.deg2rad(float(self.direction))  # numpy does not accept integers beyond 64 bits
        shares = np.array([np.cos(angle), np.sin(angle)])
        return np.where(np.abs(shares) < 1e-12, 0.0, shares)

    def samples_per_period(self, sample_rate: float) -> int:
        """Number of samples in one period.

        Raises:
            ValueError: The period is not a whole number of samples.
        """
        n = sample_rate / self.fundamental
        if abs(n - round(n)) > 1e-6 * n:
            raise ValueError(
                f"excitation: fundamental {self.fundamental} Hz does not divide the rate {sample_rate} Hz: "
                f"a period would be {n:.6g} samples; choose a fundamental that gives a whole number"
            )
        return round(n)

    def block(self, sample_rate: float) -> tuple[int, int]:
        """Samples and periods of the smallest block that holds whole numbers of both.

        Raises:
            ValueError: No block of up to MOST_BLOCK periods does; the message names fundamentals that fit.
        """
        n = sample_rate / self.fundamental
        if abs(n - round(n)) <= 1e-6 * n:
            return round(n), 1
        whole = Fraction(n).limit_denominator(MOST_BLOCK)
        if abs(float(whole) - n) > 1e-9 * n:
            near = sample_rate / round(n) if n > 1 else sample_rate / 2
            raise ValueError(
                f"excitation: fundamental {self.fundamental} Hz at the rate {sample_rate} Hz: a period would be "
                f"{n:.9g} samples, and no whole number of samples holds up to {MOST_BLOCK} whole periods; "
                f"{near:.12g} Hz would fit ({round(n)} samples)"
            )
        return whole.numerator, whole.denominator

    def on_grid(self, sample_rate: float) -> "Excitation":
        """The same signal with the block as its period: a fundamental that divides the rate, and lines to match."""
        periods = self.block(sample_rate)[1] if self.periodic else 1
        if periods == 1:
            return self
        return replace(self, fundamental=self.fundamental / periods, lines=tuple(n * periods for n in self.lines))

    def multisine(self, sample_rate: float) -> Multisine:
        """The multisine on the sample grid of `sample_rate` (Hz).

        Raises:
            ValueError: As `samples_per_period`, or a line is not below half of the sample rate.
        """
        n = self.samples_per_period(sample_rate)
        if 2 * self.lines[-1] >= n:
            raise ValueError(
                f"excitation: line {self.lines[-1]} ({self.frequencies[-1]:g} Hz) is not below half of {sample_rate} Hz"
            )
        if self.kind == "sphs":
            return sphs(self.lines, n, peak=self.amplitude)
        if self.kind == "impulse":
            return impulse(self.lines, n, peak=self.amplitude)
        if self.kind == "low_crest":
            unit = _low_crest(self.lines, n, self.seed)
            return Multisine(unit.lines, unit.amplitudes * self.amplitude, unit.phases)
        return random_phase(self.lines, n, self.seed, peak=self.amplitude)

    def waveform(self, sample_rate: float) -> np.ndarray:
        """One period, shape (samples_per_period,), in the unit of `at`; not to be written to."""
        return _period(self, sample_rate)


@lru_cache(maxsize=32)
def _period(excitation: Excitation, sample_rate: float) -> np.ndarray:
    """One period, which every block of lanes with this excitation uses."""
    found = synthesise(excitation.multisine(sample_rate), excitation.samples_per_period(sample_rate))
    found.setflags(write=False)
    return found


@lru_cache(maxsize=64)
def _low_crest(lines: tuple[int, ...], samples: int, seed: int) -> Multisine:
    """The optimised multisine, cached because the optimisation takes some tenths of a second."""
    return low_crest(lines, samples, seed=seed)


def parse_lines(text: str) -> tuple[int, ...]:
    """Harmonic numbers from the text `first:last` or `first:last:step`.

    Raises:
        ValueError: The text has another form, or it contains no harmonic from 1 up.
    """
    try:
        first, last, *step = (int(part) for part in text.split(":"))
        if last > MAX_HARMONIC:  # checked before the range is built: a typing error must not use gigabytes of memory
            raise ValueError
        lines = tuple(range(first, last + 1, *step))
    except (ValueError, TypeError):
        raise ValueError(
            f"lines {text!r}: write first:last or first:last:step, whole numbers up to {MAX_HARMONIC}"
        ) from None
    if not lines or first < 1:
        raise ValueError(f"lines {text!r} hold no harmonic from 1 up")
    return lines


def parse_excitation(text: str, fundamental: float, kind: Any = "sphs") -> Excitation:
    """A multisine from the text `place=lines@peak`, e.g. `force=1:249:2@0.4`.

    Args:
        text: lines as in `parse_lines`, peak in the unit of the place; on an x-y rig `place=lines@peak@degrees`.
        fundamental: Hz.
        kind: as in `Excitation`.

    Raises:
        ValueError: The text has another form, or a value is not valid.
    """
    at, equals, rest = text.partition("=")
    place: Any = at.strip()
    lines, *numbers = rest.split("@")
    if not equals or not 1 <= len(numbers) <= 2:
        raise ValueError(f"excitation {text!r}: write place=first:last:step@peak, e.g. force=1:250@0.4")
    try:
        amplitude, direction = (*map(float, numbers), 0.0)[:2]
    except ValueError:
        raise ValueError(f"excitation {text!r}: the peak {numbers[0]!r} or the direction is not a number") from None
    return Excitation(kind, place, fundamental, parse_lines(lines), amplitude, direction=direction)


def check_harmonics(lines: Iterable[Any], name: str) -> None:
    """Check harmonic numbers, before a range between them is built, which could use too much memory.

    Raises:
        ValueError: One is not a whole number from 1 to MAX_HARMONIC.
    """
    for line in lines:
        if isinstance(line, bool) or not isinstance(line, int | np.integer) or not 1 <= line <= MAX_HARMONIC:
            raise ValueError(f"excitation: {name}: {line!r} is not a whole number from 1 to {MAX_HARMONIC}")


def lines_at(excitations: Iterable[Excitation], place: str | None = None) -> np.ndarray:
    """Sorted harmonic numbers (lines,) of the periodic excitations at "force", "current" or "reference" (None: all)."""
    lines = [e.lines for e in excitations if e.periodic and place in (None, e.at)]
    return np.unique(np.concatenate(lines)) if lines else np.zeros(0, int)


def axis_excitations(excitations: Iterable[Excitation], axis: int) -> tuple[Excitation, ...]:
    """Components of the excitations along axis 0 (x) or 1 (y), without those that are zero.

    The direction of a component is 0, or 180 degrees if it acts against the axis.
    """
    acting = [(e, float(e.components[axis])) for e in excitations]
    return tuple(replace(e, amplitude=e.amplitude * abs(c), direction=0.0 if c > 0 else 180.0) for e, c in acting if c)


def check_interleaved(excitations: tuple[Excitation, ...]) -> None:
    """Check that the periodic excitations have the same fundamental and different lines.

    Raises:
        ValueError: They have not.
    """
    taken: dict[int, str] = {}
    fundamentals = {e.fundamental for e in excitations if e.periodic}
    if len(fundamentals) > 1:
        raise ValueError(f"excitation: fundamentals {sorted(fundamentals)} differ; one record needs one period")
    lines = [line for e in excitations for line in e.lines]
    if len(set(lines)) == len(lines):  # as mostly; a sweep asks this of every gain set
        return
    for e in excitations:
        for line in e.lines:
            if line in taken:
                raise ValueError(
                    f"excitation: line {line} is excited at both {taken[line]} and {e.at}; interleave the lines"
                )
            taken[line] = e.at
