"""Windows of DFT lines: how a record of any shape is compared with a simulation of it.

The discrete Fourier transform of a whole record, without a taper, is a response times its excitation plus a transient:
what runs into the record less what runs out of it. The transient and slow drift are smooth over a narrow window of
lines, so a quadratic in the line number is projected out of every window. What is left of a residual (measured less
simulated) is then noise, whose variance is the scatter about a local polynomial model of the same window (Schoukens,
Vandersypen, Barbe and Pintelon, European Journal of Control 15, 2009), pooled over neighbouring windows.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from estimation.lines.noise_shape import noise_shape

WIDTH = 21  # lines of a window
TERMS = 3  # of the polynomial that stands for transient and drift
KEPT = WIDTH - TERMS  # coordinates of a window
POOLED = 5  # windows whose noise is pooled
LOUDER_BY_CHANCE = 1e-5  # probability by which noise makes a window as loud that still counts as alike
NOISE_ALONE = (0.40, 0.49)  # of the sample rate: where a signal is taken to be noise alone
LEAST_FREEDOM = 3  # directions of a window that tell its noise at least, however many excitations there are
_RANK = 1e-6  # share of the strongest direction below which the excitation of a window adds no direction of its own
_ROUNDING = 1e-13  # share of an excitation's norm over all windows that may be rounding


@dataclass(frozen=True)
class LineWindows:
    """Adjoining windows of WIDTH lines of a record.

    Args:
        samples: length of the record.
        sample_rate: in Hz.
        first: number of the first line of the first window (1 is one period in the whole record).
        count: number of windows.
        turned: unitary matrices (count, KEPT, KEPT) whose columns are the coordinates of each window; None: none.
    """

    samples: int
    sample_rate: float
    first: int
    count: int
    turned: np.ndarray | None = None

    @property
    def frequency(self) -> np.ndarray:
        """Frequencies (count, WIDTH) of the lines, Hz."""
        lines = self.first + np.arange(self.count * WIDTH)
        return (lines * self.sample_rate / self.samples).reshape(self.count, WIDTH)

    @property
    def centre(self) -> np.ndarray:
        """Frequency (count,) of the middle line of each window, Hz."""
        return self.frequency[:, WIDTH // 2]

    @cached_property
    def directions(self) -> np.ndarray:
        """Orthonormal directions (WIDTH, KEPT) in which no quadratic has a part."""
        basis = np.linspace(-1, 1, WIDTH)[:, None] ** np.arange(TERMS)
        return np.linalg.qr(basis, mode="complete")[0][:, TERMS:]

    def spectrum(self, signals: np.ndarray) -> np.ndarray:
        """Complex amplitudes (..., count, WIDTH) of signals (..., samples)."""
        return self.of_transform(np.asarray(scipy.fft.rfft(signals, axis=-1)))

    def of_transform(self, transform: np.ndarray) -> np.ndarray:
        """Complex amplitudes (..., count, WIDTH) by the transform (..., samples // 2 + 1) of signals, see `rfft`."""
        lines = slice(self.first, self.first + self.count * WIDTH)
        found = transform[..., lines] * (2 / self.samples)
        return found.reshape(*found.shape[:-1], self.count, WIDTH)

    def project(self, spectrum: np.ndarray) -> np.ndarray:
        """Coordinates (..., count, KEPT) of spectra (..., count, WIDTH), without transient and drift."""
        found = spectrum @ self.directions
        return found if self.turned is None else np.einsum("...wk,wkj->...wj", found, np.conj(self.turned))

    def power(self, spectrum: np.ndarray) -> np.ndarray:
        """Power (..., count) of spectra (..., count, WIDTH), without transient and drift."""
        return np.sum(abs(self.project(spectrum)) ** 2, axis=-1)

    def lines(self, coordinates: np.ndarray) -> np.ndarray:
        """Spectra (..., count, WIDTH) that have these coordinates (..., count, KEPT), and no transient."""
        if self.turned is not None:
            coordinates = np.einsum("...wj,wkj->...wk", coordinates, self.turned)
        return coordinates @ self.directions.T

    def cleared(self, spectrum: np.ndarray) -> np.ndarray:
        """Spectra (..., count, WIDTH) with transient and drift taken out, in the same lines."""
        return self.lines(self.project(spectrum))

    def toward(self, excitation: np.ndarray) -> "LineWindows":
        """The same windows with turned coordinates: the first ones span what is excited, the others are free of it.

        Args:
            excitation: spectra (inputs, count, WIDTH).
        """
        excited = np.moveaxis(replace(self, turned=None).project(excitation), 0, -1)
        return replace(self, turned=np.linalg.svd(excited, full_matrices=True)[0])

    def along(self, projected: np.ndarray, excitation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parts of projected spectra (..., count, KEPT) that a local polynomial response would explain.

        It has TERMS for each excitation, or fewer where so many excitations would leave less than LEAST_FREEDOM
        directions for noise. Dropping the weakest directions instead would depend on the excitations' units; so would
        what counts as no direction, were the excitations not compared as shares of their norms over all windows.

        Args:
            projected: see `project`.
            excitation: spectrum (count, WIDTH) of what drove the record, or (inputs, count, WIDTH).

        Returns:
            parts: in orthonormal directions, (..., count, directions); zero in those that the excitation lacks.
            rank: number of directions in each window, (count,).
        """
        driven = np.atleast_3d(excitation.T).T if excitation.ndim == 2 else excitation
        terms = max(min(TERMS, (KEPT - LEAST_FREEDOM) // len(driven)), 1)
        powers = np.linspace(-1, 1, WIDTH)[:, None] ** np.arange(terms)
        norm = np.linalg.norm(driven.reshape(len(driven), -1), axis=1)[:, None, None]
        inputs = np.moveaxis(driven / np.where(norm > 0, norm, 1.0), 0, -1)  # (count, WIDTH, inputs)
        columns = (inputs[..., None] * powers[:, None, :]).reshape(self.count, WIDTH, -1)
        columns = np.swapaxes(np.swapaxes(columns, 1, 2) @ self.directions, 1, 2)
        u, s, _ = np.linalg.svd(columns, full_matrices=False)
        kept = s > np.maximum(_RANK * s[:, :1], _ROUNDING)
        u = np.where(kept[:, None, :], u, 0.0)
        if self.turned is not None:
            u = np.einsum("wkj,wkl->wjl", np.conj(self.turned), u)
        return np.einsum("wlk,...wl->...wk", np.conj(u), projected), kept.sum(axis=1)

    def noise(
        self,
        residual: np.ndarray,
        excitation: np.ndarray,
        shapes: np.ndarray | None = None,
        removed: np.ndarray | int = 0,
    ) -> "WindowNoise":
        """The noise of a residual, told from what the excitation explains of it.

        Args:
            residual: measured less simulated spectra, opened so that their noise is smooth, (..., count, WIDTH).
            excitation: spectrum (count, WIDTH) of what drove the record, or (inputs, count, WIDTH).
            shapes: (shapes, ..., count), what the noise may be composed of; None: it is white over POOLED windows.
            removed: number of directions in which the residual was set to zero, (count,) or (..., count).

        Returns:
            Variance of one line, pooled over POOLED windows except the lowest ones that are louder than those around
            by more than chance, because a slow noise ends in them; and the test of what the excitation still explains.
        """
        y = self.project(residual)
        inside, rank = self.along(y, excitation)
        explained = np.sum(abs(inside) ** 2, axis=-1)
        freedom = (KEPT - rank - removed).astype(float)
        rest = np.maximum(np.sum(abs(y) ** 2, axis=-1) - explained, 0.0)
        shape = np.ones_like(rest)
        if shapes is not None:
            own = rest / np.maximum(freedom, 1.0)
            for at in np.ndindex(rest.shape[:-1]):
                shape[at] = noise_shape(own[at], shapes[(slice(None), *at)])
        power, freedom = rest / shape, np.broadcast_to(freedom, rest.shape)
        around, others = _pooled(power) - power, _pooled(freedom) - freedom
        ratio = power * others / np.maximum(around * freedom, 1e-300)
        alone = (freedom >= 1) & (others >= 1) & (np.asarray(removed) == 0)  # a mode is louder than what is around it
        alone[alone] = scipy.special.fdtrc(2 * freedom[alone], 2 * others[alone], ratio[alone]) < LOUDER_BY_CHANCE
        alone = np.logical_and.accumulate(alone, axis=-1)
        quiet = _pooled(np.where(alone, 0.0, power)), _pooled(np.where(alone, 0.0, freedom))
        power, freedom = (np.where(alone, own, pooled) for own, pooled in zip((power, freedom), quiet, strict=True))
        return WindowNoise(power / freedom * shape, freedom, explained, rank)


@dataclass(frozen=True)
class WindowNoise:
    """Noise of the windows of a residual.

    Args:
        variance: E|n|^2 of one line, (..., count).
        freedom: complex degrees of freedom of that variance, (..., count).
        explained: power that the excitation explains in each window, (..., count).
        rank: number of complex directions that could explain it, (count,).
    """

    variance: np.ndarray
    freedom: np.ndarray
    explained: np.ndarray
    rank: np.ndarray

    @property
    def misfit(self) -> np.ndarray:
        """Explained power per direction over the noise, (..., count): F distributed with 2 rank and 2 freedom degrees
        of freedom where nothing but noise is left."""
        return self.explained / np.maximum(self.rank, 1) / np.maximum(self.variance, 1e-300)


def line_windows(samples: int, sample_rate: float, band: tuple[float, float]) -> LineWindows:
    """The windows of a record within a band.

    Args:
        samples: length of the record.
        sample_rate: in Hz.
        band: lowest and highest frequency, Hz.

    Raises:
        ValueError: when the band does not lie within the record, or holds fewer than POOLED windows.
    """
    low, high = band
    if not 0 <= low < high <= sample_rate / 2:
        raise ValueError(f"band {low:g} .. {high:g} Hz must increase and lie within 0 .. {sample_rate / 2:g} Hz")
    first = max(int(np.ceil(low * samples / sample_rate - 1e-6)), 1)
    stop = min(int(np.floor(high * samples / sample_rate + 1e-6)) + 1, (samples + 1) // 2)
    count = (stop - first) // WIDTH
    if count < POOLED:
        least = (POOLED * WIDTH + 1) / (high - low)
        raise ValueError(
            f"{samples / sample_rate:.3g} s hold {max(stop - first, 0)} lines between {low:g} and {high:g} Hz, and "
            f"{POOLED * WIDTH} are needed: record at least {least:.3g} s, or widen the band"
        )
    return LineWindows(samples, sample_rate, first, count)


def _pooled(values: np.ndarray) -> np.ndarray:
    """Sums (..., count) over POOLED windows around each; at the ends over as many as there are."""
    reach = POOLED // 2
    padded = np.concatenate(
        [np.zeros((*values.shape[:-1], reach + 1)), values, np.zeros((*values.shape[:-1], reach))], -1
    )
    total = np.cumsum(padded, axis=-1)
    return total[..., POOLED:] - total[..., :-POOLED]
