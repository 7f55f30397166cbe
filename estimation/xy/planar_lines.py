"""What the estimators of two coupled axes share: the lines of a band and the checks of input."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimation.bands import band_slices
from estimation.lines.periods import LineStatistics
from estimation.normal import NOISELESS

CHANNELS = ("force_x", "force_y", "displacement_x", "displacement_y")

Mass = float | np.ndarray | tuple[float | np.ndarray, float | np.ndarray]


@dataclass(frozen=True)
class PlanarLines:
    """All lines of one band.

    Attributes:
        u: Channels (lanes, n, 4).
        own: Covariance of each line (lanes, n, 4, 4).
        w: Angular frequencies (n,), rad/s.
        record: Index (n,) of each line's record into periods.
        periods: Periods (records,) of the records that have lines in this band.
    """

    u: np.ndarray
    own: NDArray[np.complex128]
    w: np.ndarray
    record: np.ndarray
    periods: np.ndarray

    def per_record(self, values: np.ndarray) -> np.ndarray:
        """Means (lanes, records, ...) over each record's lines of values (lanes, n, ...)."""
        return np.stack([values[:, self.record == r].mean(axis=1) for r in range(len(self.periods))], axis=1)


def checked_masses(
    records: Sequence[LineStatistics], bands: np.ndarray, mass: Mass, fewest: int = 1
) -> tuple[np.ndarray, tuple[int, ...]]:
    """Masses of both axes, checked together with the records and bands.

    Args:
        records: As in `eight_coefficients`.
        bands: As in `eight_coefficients`.
        mass: As in `eight_coefficients`.
        fewest: Number of lines that a band must hold, of all records together.

    Returns:
        masses: Masses (lanes, 2), kg, with the lanes flattened.
        shape: Shape (...) of the lanes.

    Raises:
        ValueError: There is no record, a channel is missing, the records differ in lanes, a band holds too few lines,
            or a mass is not positive.
    """
    if not records:
        raise ValueError("no record is given; two with different directions of the force tell all eight coefficients")
    shape = records[0].mean.shape[:-2]
    for i, record in enumerate(records):
        missing = [name for name in CHANNELS if name not in record.channels]
        if missing:
            raise ValueError(
                f"record {i}: channels {', '.join(missing)} are missing; it has {', '.join(record.channels)}"
            )
        if record.mean.shape[:-2] != shape:
            raise ValueError(f"record {i} has lanes {record.mean.shape[:-2]}, record 0 has {shape}; they must agree")
    lines = np.sum([np.diff(band_slices(record.frequency, bands), axis=1)[:, 0] for record in records], axis=0)
    if np.any(lines < fewest):
        f_lo, f_hi = bands[np.argmin(lines)]
        raise ValueError(
            f"the band {f_lo:g} .. {f_hi:g} Hz holds {lines.min()} lines of all records and needs {fewest}; "
            "choose bands on excited lines"
        )
    both = mass if isinstance(mass, tuple) else (mass, mass)
    masses = np.stack([np.broadcast_to(np.asarray(m, float), shape).reshape(-1) for m in both], axis=-1)
    if not np.all(masses > 0):
        raise ValueError(f"mass = {mass} kg must be positive; pass the moving mass of each axis")
    return masses, shape


def planar_lines(records: Sequence[LineStatistics], edges: np.ndarray) -> PlanarLines:
    """The lines of all records within edges (f_lo, f_hi) Hz, at least one line; see `checked_masses`."""
    means, covariances, frequencies, periods = [], [], [], []
    for record in records:
        ((start, stop),) = band_slices(record.frequency, edges[None])
        if start == stop:
            continue
        keep, channels = [record.index(name) for name in CHANNELS], len(record.channels)
        mean = record.mean[..., start:stop].reshape(-1, channels, stop - start)[:, keep]
        own = record.covariance[..., start:stop].reshape(-1, channels, channels, stop - start)[:, keep][:, :, keep]
        # A record without noise keeps a weight.
        own[:, [0, 1], [0, 1]] += NOISELESS * (np.abs(mean[:, :2]) ** 2).sum(1).mean(-1)[:, None, None]
        means.append(np.moveaxis(mean, -1, 1))
        covariances.append(np.moveaxis(own, -1, 1))
        frequencies.append(record.frequency[start:stop])
        periods.append(record.periods)
    index = np.repeat(np.arange(len(periods)), [f.size for f in frequencies])
    u, own = (np.concatenate(parts, axis=1, dtype=complex) for parts in (means, covariances))
    return PlanarLines(u, own, 2 * np.pi * np.concatenate(frequencies), index, np.array(periods))


def equation_rows(lines: PlanarLines, masses: np.ndarray) -> np.ndarray:
    """Matrices (lanes, n, 6, 4) that turn a line's channels into the terms of the equations of motion.

    The terms are X, Y, j w X, j w Y, F_x + m_x w^2 X and F_y + m_y w^2 Y.
    """
    rows = np.zeros((len(masses), len(lines.w), 6, 4), complex)
    for axis in range(2):
        rows[:, :, axis, 2 + axis] = 1.0
        rows[:, :, 2 + axis, 2 + axis] = 1j * lines.w
        rows[:, :, 4 + axis, axis] = 1.0
        rows[:, :, 4 + axis, 2 + axis] = masses[:, axis, None] * lines.w**2
    return rows
