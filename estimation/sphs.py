"""Periodic multisines: which harmonics a period excites, with which amplitudes and phases.

Schroeder-phased harmonic sequences (SPHS) follow Appendix A of the dissertation (D), random-phase multisines and odd
grids with detection lines follow Pintelon and Schoukens. A line is a harmonic number of the fundamental; a period is
sampled on a grid of N samples, so line l lies at l * sample_rate / N hertz and must stay below N / 2.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class Multisine:
    """A period of sum_i amplitudes[i] cos(2 pi lines[i] t / T + phases[i]).

    lines (n,) strictly increasing harmonic numbers >= 1; amplitudes (n,) peak amplitude of each line in the signal's
    unit; phases (n,) rad. The arrays are copied and read-only. Raises ValueError if they do not fit this.
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
    """Schroeder phases (n,) in rad, D eq A.3 summed: phi_n = -2 pi sum over m < n of (n - m) P_m.

    power (n,): positive power per excited line, in any unit; it is normalised to a sum of 1 (D eq A.1). lines (n,):
    the harmonics excited (default: consecutive). Suppressed harmonics between them count as lines of zero power, in
    steps of the lines' common spacing, so that odd lines are as flat as consecutive ones. Raises ValueError if power
    is empty or not positive or the lines do not fit it.
    """
    share = _checked_power(power)
    steps = np.diff(_checked_lines(lines)) if lines is not None else np.ones(share.size - 1, dtype=np.int64)
    if steps.size != share.size - 1:
        raise ValueError(f"lines must hold one harmonic per power: {share.size} values")
    spacing = np.gcd.reduce(steps) if steps.size else 1
    return -2 * np.pi * np.concatenate([[0.0], np.cumsum(steps // spacing * np.cumsum(share)[:-1])])


def synthesise(multisine: Multisine, samples_per_period: int) -> NDArray[np.float64]:
    """One period (N,) of the multisine, by inverse FFT, in the unit of its amplitudes.

    samples_per_period: N. Raises ValueError if a line does not lie below N / 2.
    """
    _check_grid(multisine.lines, samples_per_period)
    spectrum = np.zeros(samples_per_period // 2 + 1, dtype=complex)
    spectrum[multisine.lines] = multisine.amplitudes / 2 * np.exp(1j * multisine.phases)
    return np.fft.irfft(spectrum, n=samples_per_period, norm="forward")


def sphs(lines: ArrayLike, samples_per_period: int, peak: float = 1.0, power: ArrayLike | None = None) -> Multisine:
    """Schroeder-phased multisine whose sampled period peaks at exactly `peak`.

    lines (n,) harmonics; samples_per_period: the grid on which the peak is taken; peak: largest absolute value, in the
    signal's unit; power (n,): relative power per line, flat by default. Amplitudes are in proportion to sqrt(2 P), with
    which the total power is 1 before scaling; D eq A.2 has sqrt(P / 2), which gives 1/4. Raises ValueError on bad
    input.
    """
    lines, share = _checked_design(lines, samples_per_period, power)
    return _scaled(lines, share, schroeder_phases(share, lines), samples_per_period, peak)


def random_phase(
    lines: ArrayLike, samples_per_period: int, seed: int, peak: float = 1.0, power: ArrayLike | None = None
) -> Multisine:
    """Multisine with phases drawn evenly from [0, 2 pi), scaled as in `sphs`.

    seed: the same seed gives the same phases. Several seeds show the stochastic part of nonlinear distortion, which
    one fixed set of phases cannot. Raises ValueError on bad input.
    """
    lines, share = _checked_design(lines, samples_per_period, power)
    phases = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, lines.size)
    return _scaled(lines, share, phases, samples_per_period, peak)


def harmonic_range(first: int, last: int, suppressed: Iterable[int] = ()) -> NDArray[np.int64]:
    """All harmonics first..last (both included) but the suppressed ones, for instance mains or shaft orders.

    Raises ValueError if the range is not 1 <= first <= last or if nothing is left.
    """
    _check_range(first, last)
    lines = np.setdiff1d(np.arange(first, last + 1), np.fromiter(suppressed, dtype=np.int64))
    if lines.size == 0:
        raise ValueError("suppressed leaves no line to excite; suppress fewer")
    return lines


def odd_lines(first: int, last: int) -> NDArray[np.int64]:
    """The odd harmonics in first..last (both included). Raises ValueError if there are none."""
    _check_range(first, last)
    lines = np.arange(first + (first + 1) % 2, last + 1, 2)
    if lines.size == 0:
        raise ValueError("first and last hold no odd harmonic; widen the range")
    return lines


def odd_random_grid(
    first: int, last: int, seed: int, group: int = 4
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Odd multisine lines with detection lines: (excited, detection_odd, detection_even), harmonic numbers.

    Of each `group` consecutive odd harmonics one, drawn at random by `seed`, is not excited: what appears there is odd
    nonlinear distortion; what appears at the even harmonics is even distortion (Pintelon and Schoukens). A last group
    that is not full keeps all its lines. Raises ValueError if group < 2 or the range holds no full group.
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
    """Largest absolute value of signal (N,) over its root mean square. Raises ValueError if it is empty or zero."""
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
