"""Periodic multisines: which harmonics a period excites, and with which amplitudes and phases.

Schroeder-phased harmonic sequences (SPHS) follow Appendix A of the dissertation (D); random-phase multisines and odd
grids with detection lines follow Pintelon and Schoukens. A line is a harmonic number of the fundamental. A period is
sampled at N points, so line l lies at l * sample_rate / N hertz and must stay below N / 2.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class Multisine:
    """A period of sum_i amplitudes[i] cos(2 pi lines[i] t / T + phases[i]). The arrays are copied and read-only.

    Attributes:
        lines: Strictly increasing harmonic numbers (n,), at least 1.
        amplitudes: Peak amplitudes (n,) of the lines, in the signal's unit.
        phases: Phases (n,), rad.

    Raises:
        ValueError: The arrays do not satisfy this.
    """

    lines: NDArray[np.int64]
    amplitudes: NDArray[np.float64]
    phases: NDArray[np.float64]

    def __post_init__(self) -> None:
        lines = _checked_lines(self.lines)
        parts = {"amplitudes": np.array(self.amplitudes, dtype=float), "phases": np.array(self.phases, dtype=float)}
        for name, values in parts.items():
            if values.shape != lines.shape or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} must be finite, one per line: {lines.size} values")
        if np.any(parts["amplitudes"] < 0):
            raise ValueError("amplitudes must not be negative; add pi to the phase instead")
        for name, values in {"lines": lines, **parts}.items():
            values.flags.writeable = False
            object.__setattr__(self, name, values)


def schroeder_phases(power: ArrayLike, lines: ArrayLike | None = None) -> NDArray[np.float64]:
    """Schroeder phases in rad, D eq A.3 summed: phi_n = -2 pi sum over m < n of (n - m) P_m.

    Args:
        power: Positive power (n,) per excited line, in any unit; it is normalised to a sum of 1 (D eq A.1).
        lines: Excited harmonics (n,), by default consecutive. Suppressed harmonics between them count as lines of
            zero power, in steps of the lines' common spacing, so that odd lines give as flat a signal as consecutive
            ones.

    Returns:
        Phases (n,), rad.

    Raises:
        ValueError: The power is empty or not positive, or the lines do not match it.
    """
    share = _checked_power(power)
    steps = np.diff(_checked_lines(lines)) if lines is not None else np.ones(share.size - 1, dtype=np.int64)
    if steps.size != share.size - 1:
        raise ValueError(f"lines must hold one harmonic per power: {share.size} values")
    spacing = np.gcd.reduce(steps) if steps.size else 1
    return -2 * np.pi * np.concatenate([[0.0], np.cumsum(steps // spacing * np.cumsum(share)[:-1])])


def synthesise(multisine: Multisine, samples_per_period: int) -> NDArray[np.float64]:
    """One period (N,) of the multisine by inverse FFT, in the unit of its amplitudes.

    Raises:
        ValueError: A line does not lie below samples_per_period / 2.
    """
    _check_grid(multisine.lines, samples_per_period)
    spectrum = np.zeros(samples_per_period // 2 + 1, dtype=complex)
    spectrum[multisine.lines] = multisine.amplitudes / 2 * np.exp(1j * multisine.phases)
    return np.fft.irfft(spectrum, n=samples_per_period, norm="forward")


def sphs(lines: ArrayLike, samples_per_period: int, peak: float = 1.0, power: ArrayLike | None = None) -> Multisine:
    """Schroeder-phased multisine whose sampled period peaks at exactly `peak`.

    Amplitudes are proportional to sqrt(2 P), which makes the total power 1 before scaling; D eq A.2 has sqrt(P / 2),
    which makes it 1/4.

    Args:
        lines: Harmonics (n,).
        samples_per_period: Grid on which the peak is determined.
        peak: Largest absolute value, in the signal's unit.
        power: Relative power (n,) per line, equal by default.

    Raises:
        ValueError: Bad input.
    """
    lines, share = _checked_design(lines, samples_per_period, power)
    return _scaled(lines, share, schroeder_phases(share, lines), samples_per_period, peak)


def impulse(lines: ArrayLike, samples_per_period: int, peak: float = 1.0, power: ArrayLike | None = None) -> Multisine:
    """Multisine with all lines in phase: one blow a period, at its start, as a mallet gives it.

    The blow's area is peak / (2 f_top) for consecutive lines from 1 up to f_top (Hz); its mean over the period is 0.

    Args:
        lines: As in `sphs`.
        samples_per_period: As in `sphs`.
        peak: As in `sphs`.
        power: As in `sphs`.

    Raises:
        ValueError: Bad input.
    """
    lines, share = _checked_design(lines, samples_per_period, power)
    return _scaled(lines, share, np.zeros(lines.size), samples_per_period, peak)


def random_phase(
    lines: ArrayLike, samples_per_period: int, seed: int, peak: float = 1.0, power: ArrayLike | None = None
) -> Multisine:
    """Multisine with phases drawn evenly from [0, 2 pi), scaled as in `sphs`.

    Several seeds reveal the stochastic part of nonlinear distortion, which one fixed set of phases cannot.

    Args:
        lines: As in `sphs`.
        samples_per_period: As in `sphs`.
        seed: Seed of the phases.
        peak: As in `sphs`.
        power: As in `sphs`.

    Raises:
        ValueError: Bad input.
    """
    lines, share = _checked_design(lines, samples_per_period, power)
    phases = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, lines.size)
    return _scaled(lines, share, phases, samples_per_period, peak)


def harmonic_range(first: int, last: int, suppressed: Iterable[int] = ()) -> NDArray[np.int64]:
    """All harmonics first..last (both included) without the suppressed ones, for instance mains or shaft orders.

    Raises:
        ValueError: The range is not 1 <= first <= last, or nothing is left.
    """
    _check_range(first, last)
    lines = np.setdiff1d(np.arange(first, last + 1), np.fromiter(suppressed, dtype=np.int64))
    if lines.size == 0:
        raise ValueError("suppressed leaves no line to excite; suppress fewer")
    return lines


def odd_lines(first: int, last: int) -> NDArray[np.int64]:
    """The odd harmonics in first..last (both included).

    Raises:
        ValueError: There are none.
    """
    _check_range(first, last)
    lines = np.arange(first + (first + 1) % 2, last + 1, 2)
    if lines.size == 0:
        raise ValueError("first and last hold no odd harmonic; widen the range")
    return lines


def odd_random_grid(
    first: int, last: int, seed: int, group: int = 4
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Odd multisine lines with detection lines (Pintelon and Schoukens).

    In each group of consecutive odd harmonics one, drawn at random, is not excited. Power that appears there is odd
    nonlinear distortion; power at the even harmonics is even distortion. An incomplete last group keeps all its lines.

    Args:
        first: First harmonic.
        last: Last harmonic.
        seed: Seed of the draw.
        group: Odd harmonics per group.

    Returns:
        Harmonic numbers (excited, detection_odd, detection_even).

    Raises:
        ValueError: group < 2, or the range holds no complete group.
    """
    odd = odd_lines(first, last)
    if group < 2:
        raise ValueError("group must be at least 2, or no line is excited")
    full = odd.size // group
    if full == 0:
        raise ValueError(f"first and last hold {odd.size} odd harmonics, fewer than one group of {group}; widen them")
    left_out = np.arange(full) * group + np.random.default_rng(seed).integers(0, group, full)
    excited = np.ones(odd.size, dtype=bool)
    excited[left_out] = False
    return odd[excited], odd[~excited], np.arange(first + first % 2, last + 1, 2)


def crest_factor(signal: ArrayLike) -> float:
    """Largest absolute value of signal (N,) over its root mean square.

    Raises:
        ValueError: The signal is empty or zero.
    """
    values = np.asarray(signal, dtype=float)
    if values.ndim != 1 or not np.any(values):
        raise ValueError("signal must be a one-dimensional array that is not all zero")
    return float(np.max(np.abs(values)) / np.sqrt(np.mean(values**2)))


def _scaled(
    lines: NDArray[np.int64], share: NDArray[np.float64], phases: NDArray[np.float64], samples: int, peak: float
) -> Multisine:
    if not (np.isfinite(peak) and peak > 0):
        raise ValueError("peak must be positive and finite")
    amplitudes = np.sqrt(2 * share)
    largest = np.max(np.abs(synthesise(Multisine(lines, amplitudes, phases), samples)))
    return Multisine(lines, amplitudes * (peak / largest), phases)


def _checked_design(
    lines: ArrayLike, samples: int, power: ArrayLike | None
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    checked = _checked_lines(lines)
    _check_grid(checked, samples)
    share = _checked_power(np.ones(checked.size) if power is None else power)
    if share.size != checked.size:
        raise ValueError(f"power must hold one value per line: {checked.size}, not {share.size}")
    return checked, share


def _checked_lines(lines: ArrayLike) -> NDArray[np.int64]:
    values = np.array(lines)
    if values.ndim != 1 or values.size == 0 or not np.issubdtype(values.dtype, np.integer):
        raise ValueError("lines must be a non-empty one-dimensional sequence of integer harmonic numbers")
    if values[0] < 1 or np.any(np.diff(values) <= 0):
        raise ValueError("lines must increase strictly and start at 1 or above")
    return values.astype(np.int64)


def _checked_power(power: ArrayLike) -> NDArray[np.float64]:
    values = np.asarray(power, dtype=float)
    if values.ndim != 1 or values.size == 0 or not np.all(np.isfinite(values)) or np.any(values <= 0):
        raise ValueError("power must be a non-empty one-dimensional array of positive values; leave out unused lines")
    return values / np.sum(values)


def _check_grid(lines: NDArray[np.int64], samples: int) -> None:
    if 2 * lines[-1] >= samples:
        raise ValueError(f"samples_per_period must exceed twice the highest line: more than {2 * lines[-1]}")


def _check_range(first: int, last: int) -> None:
    if not 1 <= first <= last:
        raise ValueError("first and last must satisfy 1 <= first <= last")
