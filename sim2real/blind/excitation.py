"""Excitation of the twin's recordings: interleaved odd random-phase multisines with detection lines."""

from dataclasses import dataclass, replace

import numpy as np

FUNDAMENTAL = 2.0  # Hz
SHAKER_LAST, INJECTION_LAST = 125, 999  # harmonics: 250 Hz and 2 kHz
HIGH_LINES = 40
GROUP = 5  # of this many consecutive odd harmonics, one is left out and one is given to the injection


@dataclass(frozen=True)
class Grid:
    """Excited harmonics of FUNDAMENTAL: those of the shaker (none without a shaker) and those of the injection."""

    force: tuple[int, ...]
    injection: tuple[int, ...]

    @property
    def lines(self) -> np.ndarray:
        """Excited and detection lines: every harmonic up to the shaker's last, and the injection's lines above."""
        return np.union1d(np.arange(1, SHAKER_LAST + 1), self.injection)


@dataclass(frozen=True)
class Drive:
    """One period of force (N) and of injection (A) at the control rate, and a static reference (m)."""

    grid: Grid
    force: np.ndarray
    injection: np.ndarray
    reference: float = 0.0

    def scaled(self, factor: float) -> "Drive":
        """The same drive at another amplitude."""
        return replace(self, force=self.force * factor, injection=self.injection * factor)


def draw_grid(rng: np.random.Generator, shaker: bool) -> Grid:
    """Draw the lines of a campaign. Without a shaker, the injection also takes the shaker's lines."""
    odd = np.arange(1, SHAKER_LAST + 1, 2)
    force, low = [], []
    for start in range(0, odd.size, GROUP):
        group = rng.permutation(odd[start : start + GROUP])
        low.append(int(group[0]))
        force.extend(group[2:].tolist())
    above = np.geomspace(SHAKER_LAST + 2, INJECTION_LAST, HIGH_LINES)
    high = np.unique(2 * (above // 2).astype(int) + 1)
    if shaker:
        return Grid(tuple(sorted(force)), (*sorted(low), *high.tolist()))
    return Grid((), (*sorted(low + force), *high.tolist()))


def draw_drive(rng: np.random.Generator, grid: Grid, force_peak: float, injection_peak: float, samples: int) -> Drive:
    """Random phases on a grid with equal amplitudes, scaled to the peaks (N, A) over `samples` per period."""
    force = _multisine(rng, grid.force, force_peak, samples)
    return Drive(grid, force, _multisine(rng, grid.injection, injection_peak, samples))


def _multisine(rng: np.random.Generator, lines: tuple[int, ...], peak: float, samples: int) -> np.ndarray:
    if not lines:
        return np.zeros(samples)
    spectrum = np.zeros(samples // 2 + 1, complex)
    spectrum[list(lines)] = np.exp(1j * rng.uniform(0, 2 * np.pi, len(lines)))
    wave = np.fft.irfft(spectrum, samples)
    return wave * (peak / np.abs(wave).max())
