"""Estimates of every band of every lane, behind `estimation.max_likelihood`.

The search and its notation are in `band_search`, the standard errors in `band_errors`, the bounds of intervals in
`band_bounds`. Arrays of cells have the shape (..., blocks, bands, LANES).
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain
from threading import Lock

import numpy as np

from estimation.band_search import GIVEN, GK, LAST, search
from estimation.band_sums import SUMS, line_sums, sums_over_bands
from maglev_lanes.layout import LANES, aligned, row

_MAKING = Lock()  # threads that need a kernel at the same time make it once


@dataclass(frozen=True)
class Bands:
    """Lanes and bands as the kernels take them.

    Attributes:
        data: (blocks, n, channels, LANES), whose last lanes are zero where there are no more.
        w: Angular frequencies (n,), rad/s.
        slices: First line and the one behind the last of every band (bands, 2).
        lanes: Number of lanes.
        given: Rows M to PI of `band_search`, flat.
        mass: Cells of it, kg.
        pooled: Covariances of a line's noise, the mean over the band, (4, cells): of the force, of the displacement,
            and of both, real and imaginary.
        moments: Sums over the band, (4, cells): |Y|^2, w^2 |Y|^2, Re F Y*, w Im F Y*.
    """

    data: np.ndarray
    w: np.ndarray
    slices: np.ndarray
    lanes: int
    given: np.ndarray
    mass: np.ndarray
    pooled: np.ndarray
    moments: np.ndarray

    @property
    def count(self) -> np.ndarray:
        """Number of lines of every band, (bands, 1)."""
        return np.diff(self.slices, axis=1).astype(float)

    def of_lanes(self, cells: np.ndarray) -> np.ndarray:
        """(..., lanes, bands) of cells."""
        turned = np.swapaxes(cells, -1, -2)
        return turned.reshape(*cells.shape[:-3], -1, cells.shape[-2])[..., : self.lanes, :]

    def found(self, starts: np.ndarray, held: np.uint64, tolerance: float) -> np.ndarray:
        """Points (6, cells) of least cost: k, c, the cost, and its half Hessian (kk, kc, cc).

        Args:
            starts: k and c (any, 2, cells), from the cheapest of which the search begins; nan: no start.
            held: see `band_search`.
            tolerance: Change of the cost that counts as converged.
        """
        out = np.empty((*self.mass.shape[:2], row(int(GK)), LANES))
        scratch = aligned((int(GIVEN),)), aligned((int(LAST),))
        starts = np.moveaxis(starts, (0, 1), (2, 3)).reshape(-1)
        _made(search)(*self._flat(), self.given, starts, held, tolerance, *scratch, out.reshape(-1))
        return np.moveaxis(out, 2, 0)

    def sums(self, points: np.ndarray) -> np.ndarray:
        """Rows H to CI of `band_sums`, (any, cells), at points (6, cells)."""
        out = np.empty((*self.mass.shape[:2], row(int(SUMS)), LANES))
        scratch = aligned((int(GIVEN),)), aligned((int(LAST),))
        _made(line_sums)(*self._flat(), self.given, _rows(points), *scratch, out.reshape(-1))
        return np.moveaxis(out, 2, 0)

    def _flat(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.data.reshape(-1), self.w, self.slices.astype(np.uint64).reshape(-1)


def bands_of(
    force: np.ndarray, disp: np.ndarray, sff: np.ndarray, syy: np.ndarray, sfy: np.ndarray, w: np.ndarray,
    mass: np.ndarray, slices: np.ndarray,
) -> Bands:  # fmt: skip
    """Lanes and bands.

    Args:
        force, disp: amplitudes (lanes, n).
        sff, syy, sfy: covariances of their noise (lanes, n).
        w, slices: as in `Bands`.
        mass: (lanes,), kg.
    """
    lanes, n = force.shape
    whole, rest = divmod(lanes, LANES)
    parts = (force.real, force.imag, disp.real, disp.imag, sff, syy, sfy.real, sfy.imag)
    data = aligned((whole + (rest > 0), n, len(parts), LANES))
    data[whole:] = 0.0
    for channel, values in enumerate(parts):
        data[:whole, :, channel] = values[: whole * LANES].reshape(whole, LANES, n).transpose(0, 2, 1)
        if rest:
            data[whole, :, channel, :rest] = values[whole * LANES :].T
    f_re, f_im, y_re, y_im = (data[:, :, channel] for channel in range(4))
    terms = np.empty_like(data)
    terms[:, :, 4:] = data[:, :, 4:]
    of_w = w[:, None]
    terms[:, :, 0] = y_re * y_re + y_im * y_im
    terms[:, :, 1] = of_w**2 * terms[:, :, 0]
    terms[:, :, 2] = f_re * y_re + f_im * y_im
    terms[:, :, 3] = of_w * (f_im * y_re - f_re * y_im)
    sums = np.zeros((len(data), len(slices), 8, LANES))
    flat = slices.astype(np.uint64).reshape(-1)
    _made(sums_over_bands)(terms.reshape(-1), flat, np.uint64(n), np.uint64(8 * LANES), sums.reshape(-1))
    sums = np.moveaxis(sums, 2, 0)
    pooled = sums[4:] / np.diff(slices, axis=1)
    masses = np.ones(len(data) * LANES)
    masses[:lanes] = mass
    cells = np.broadcast_to(masses.reshape(-1, 1, LANES), sums.shape[1:])
    return Bands(data, w, slices, lanes, _rows(cells[None], pooled), cells, pooled, sums[:4])


def _rows(*groups: np.ndarray) -> np.ndarray:
    """Groups of rows (any, cells), flat, in the order of the kernels: blocks, bands, rows, LANES."""
    blocks, bands, lanes = groups[0].shape[1:]
    out = np.empty((blocks, bands, sum(map(len, groups)), lanes))
    for at, values in enumerate(chain.from_iterable(groups)):
        out[:, :, at] = values
    return out.reshape(-1)


def _made(kernel: Callable[[], Callable[..., None]]) -> Callable[..., None]:
    with _MAKING:
        return kernel()
