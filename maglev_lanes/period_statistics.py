"""Means and covariances over periods of lines' amplitudes, for all lanes of a block at once."""

from collections.abc import Callable, Sequence
from functools import cache
from threading import Lock

import numpy as np

from maglev_lanes.butterflies import IM, SIZE
from maglev_lanes.compiled import compiled
from maglev_lanes.layout import LANES as W
from maglev_lanes.pieces import piece

_MAKING = Lock()


class PeriodStatistics:
    """Gathers one period at a time (Welford), so that memory does not grow with the number of periods.

    Args:
        channels: number of channels.
        noisy: numbers of those that differ between periods; the others have no covariance.
        lines: number of lines.
    """

    def __init__(self, channels: int, noisy: Sequence[int], lines: int) -> None:
        self.periods = 0
        self._noisy = np.array(noisy, np.int64)
        self._mean = np.zeros((channels, lines, 2, W))
        self._second = np.zeros((len(noisy), len(noisy), lines, 2, W))

    @classmethod
    def of(cls, periods: int, noisy: Sequence[int], mean: np.ndarray, second: np.ndarray) -> "PeriodStatistics":
        """What was gathered elsewhere.

        Args:
            periods: their number.
            noisy: as above.
            mean: (channels, lines, 2, LANES).
            second: sums of the products of deviations, (noisy, noisy, lines, 2, LANES), those of a later channel with
                an earlier one.
        """
        found = cls(0, noisy, 0)
        found.periods, found._mean, found._second = periods, mean, second
        return found

    @property
    def gathered(self) -> tuple[np.ndarray, np.ndarray]:
        """What `of` takes: mean and second."""
        return self._mean, self._second

    def add(self, spectra: np.ndarray) -> None:
        """Add a period's amplitudes (channels, lines, 2, LANES), real and imaginary parts, which are overwritten."""
        self.periods += 1
        if self.periods == 1:
            self._mean[:] = spectra
            return
        with _MAKING:
            add = _add()
        flat = spectra.reshape(-1), self._mean.reshape(-1), self._second.reshape(-1)
        add(*flat, self._noisy, spectra.shape[1], self.periods, W)

    def mean(self) -> np.ndarray:
        """Mean amplitudes, complex (LANES, channels, lines)."""
        return self._whole()[0]

    def covariance(self) -> np.ndarray:
        """Covariances of the means, E[n_a conj(n_b)], complex (LANES, channels, channels, lines).

        It is the sample covariance over the periods divided by their number.
        """
        return self._whole()[1]

    def write(
        self, mean: np.ndarray, covariance: np.ndarray, lanes: np.ndarray, channels: Sequence[int], lines: np.ndarray
    ) -> None:
        """Write `mean` and `covariance` of some lanes, channels and lines, given by their numbers, into arrays."""
        parts = _parts(mean)
        for i, channel in enumerate(channels):
            parts[:, i] = _of_lanes(self._mean[channel], lanes, lines)
        numbers = {channel: i for i, channel in enumerate(self._noisy.tolist())}
        share, parts = 1.0 / ((self.periods - 1) * self.periods), _parts(covariance)
        for i, a in enumerate(channels):
            for j, b in enumerate(channels):
                if a not in numbers or b not in numbers:
                    parts[:, i, j] = 0.0
                elif b <= a:
                    parts[:, i, j] = _of_lanes(self._second[numbers[a], numbers[b]], lanes, lines)
                    parts[:, i, j] *= share
                else:
                    parts[:, i, j] = _of_lanes(self._second[numbers[b], numbers[a]], lanes, lines)
                    parts[:, i, j] *= (share, -share)

    def _whole(self) -> tuple[np.ndarray, np.ndarray]:
        channels, lines = self._mean.shape[:2]
        found = np.empty((W, channels, lines), complex), np.empty((W, channels, channels, lines), complex)
        self.write(*found, np.arange(W), range(channels), np.arange(lines))
        return found


def as_complex(parts: np.ndarray) -> np.ndarray:
    """Complex numbers with the lanes first, from (..., 2, LANES)."""
    return np.moveaxis(parts[..., 0, :] + 1j * parts[..., 1, :], -1, 0)


def _parts(values: np.ndarray) -> np.ndarray:
    """Real and imaginary parts (..., 2) of complex numbers, as a view."""
    return values.view(float).reshape(*values.shape, 2)


def _of_lanes(values: np.ndarray, lanes: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """(lanes, lines, 2) of (lines, 2, LANES)."""
    return values[lines][..., lanes].transpose(2, 0, 1)


@piece
def approach(z, mean, k, count):
    """Turn a number of z into its deviation from the mean, which then takes its share of it."""
    z[k] -= mean[k]
    mean[k] += z[k] / count


@piece
def covary(z, second, p, q, o, share):
    """Add the product of the complex deviation at p and the conjugate one at q."""
    im = np.uint64(IM)
    ax, ay, bx, by = z[p], z[p + im], z[q], z[q + im]
    second[o] += share * (ax * bx + ay * by)
    second[o + im] += share * (ay * bx - ax * by)


@cache
def _add() -> Callable[..., None]:
    sources = 0  # see `compiled`

    def add(z, mean, second, noisy, lines, count, lanes):
        if sources == 0:
            return
        both = np.uint64(2 * lanes)
        for a in range(noisy.size):
            for n in range(lines):
                k = np.uint64((noisy[a] * lines + n) * SIZE)
                for i in range(both):
                    approach(z, mean, k + i, count)
        share = (count - 1.0) / count
        for a in range(noisy.size):
            for b in range(a + 1):
                for n in range(lines):
                    p, q = np.uint64((noisy[a] * lines + n) * SIZE), np.uint64((noisy[b] * lines + n) * SIZE)
                    o = np.uint64(((a * noisy.size + b) * lines + n) * SIZE)
                    for i in range(np.uint64(lanes)):
                        covary(z, second, p + i, q + i, o + i, share)

    return compiled(add)
