"""Stiffness and damping matrices of two coupled axes, F = (K - w^2 diag(m_x, m_y) + j w C) (X, Y), per band.

The dissertation (D) fits the eight coefficients of eq 5.5-5.9 to one excitation. That moves x and y along one line and
tells only what each row does along it (`row_sums`); two independent excitations tell the coefficients apart.
Matrices are indexed (force axis, motion axis): stiffness[..., 0, 1] is k_xy.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import special

from estimation import planar_likelihood
from estimation.bands import band_slices
from estimation.max_likelihood import BandEstimate, maximum_likelihood
from estimation.periods import LineStatistics

CHANNELS = ("force_x", "force_y", "displacement_x", "displacement_y")
CONDITION_LIMIT = 30.0  # Belsley, Kuh and Welsch 1980: from here on collinearity harms
_NOISE_LEVEL = 1e-3  # chance that noise alone passes for motion in a direction of its own

Mass = float | np.ndarray | tuple[float | np.ndarray, float | np.ndarray]


@dataclass(frozen=True)
class PlanarEstimate:
    """Per lane and band; stiffness N/m and damping N s/m (..., bands, 2, 2), the rest (..., bands) unless said.

    *_se standard errors; *_low, *_high profile-likelihood bounds, -inf or inf where the data do not bound them; cost at
    the minimum; fit_p: p-value that constant coefficients explain the band; informative: all eight intervals are
    bounded; noise_share: share of the measured |X|^2 + |Y|^2 that is noise; condition: condition number of the columns
    X, Y, j w X, j w Y, each scaled to length 1 and freed of noise (inf: not told from noise); *_inflation
    (..., bands, 2, 2): variance inflation factors, the same in both rows; identifiable: condition <= CONDITION_LIMIT,
    elsewhere all but condition, inflation and noise share is nan.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    stiffness_se: np.ndarray
    damping_se: np.ndarray
    stiffness_low: np.ndarray
    stiffness_high: np.ndarray
    damping_low: np.ndarray
    damping_high: np.ndarray
    stiffness_inflation: np.ndarray
    damping_inflation: np.ndarray
    cost: np.ndarray
    fit_p: np.ndarray
    informative: np.ndarray
    noise_share: np.ndarray
    condition: np.ndarray
    identifiable: np.ndarray


@dataclass(frozen=True)
class RowSums:
    """What one excitation tells: the direct coefficients of each axis, and the motion they hold for.

    x, y: one-axis estimates. With ratio = Y / X (complex, (..., bands)) constant over the band x.stiffness is
    k_xx + Re(ratio) k_xy - w Im(ratio) c_xy and x.damping c_xx + Re(ratio) c_xy + Im(ratio) k_xy / w; y likewise with
    1 / ratio. Where x = y they are the row sums. ratio_spread: rms deviation of the lines from ratio, freed of noise.
    """

    x: BandEstimate
    y: BandEstimate
    ratio: np.ndarray
    ratio_spread: np.ndarray


def axis_statistics(statistics: LineStatistics, axis: Literal["x", "y"]) -> LineStatistics:
    """The channels of one axis under their one-axis names: "force_x" becomes "force".

    The one-axis estimators then give D's direct coefficients (eq 5.10-5.12): the force is the component along the axis.
    ValueError when the axis has no force or no displacement.
    """
    keep = [i for i, name in enumerate(statistics.channels) if name.endswith(f"_{axis}")]
    for name in (f"force_{axis}", f"displacement_{axis}"):
        statistics.index(name)
    return replace(
        statistics,
        channels=tuple(statistics.channels[i].removesuffix(f"_{axis}") for i in keep),
        mean=statistics.mean[..., keep, :],
        covariance=statistics.covariance[..., keep, :, :][..., keep, :],
    )


def row_sums(
    statistics: LineStatistics, bands: np.ndarray, mass: Mass, intervals: bool = True, level: float = 0.95
) -> RowSums:
    """Direct coefficients of both axes from one record; arguments as in `eight_coefficients`."""
    masses, shape = _checked([statistics], bands, mass)
    x, y = (
        maximum_likelihood(axis_statistics(statistics, axis), bands, m.reshape(shape), intervals, level)
        for axis, m in zip(("x", "y"), masses.T, strict=True)
    )
    ratio, spread = np.empty((*shape, len(bands)), complex), np.empty((*shape, len(bands)))
    dx, dy = statistics.amplitude("displacement_x"), statistics.amplitude("displacement_y")
    nx, ny = (statistics.cross(f"displacement_{a}", f"displacement_{a}") for a in "xy")
    nyx = statistics.cross("displacement_y", "displacement_x")
    for b, (start, stop) in enumerate(band_slices(statistics.frequency, bands)):
        xx, yy, yx = (
            a[..., start:stop].sum(-1) for a in (np.abs(dx) ** 2 - nx, np.abs(dy) ** 2 - ny, dy * np.conj(dx) - nyx)
        )
        with np.errstate(divide="ignore", invalid="ignore"):  # x may stand still
            ratio[..., b] = yx / xx
            spread[..., b] = np.sqrt(np.maximum(yy / xx - np.abs(yx / xx) ** 2, 0.0))
    return RowSums(x, y, ratio, spread)


def eight_coefficients(
    records: Sequence[LineStatistics],
    bands: np.ndarray,
    mass: Mass,
    intervals: bool = True,
    level: float = 0.95,
) -> PlanarEstimate:
    """Minimise sum e^H S^-1 e, e = F - Z (X, Y), S its covariance, over the lines of all records in each band.

    records: channels `CHANNELS` at their force lines, the same lanes in each, lines and periods of their own; bands
    (b, 2) Hz; mass kg, of both axes or a tuple (m_x, m_y), each a scalar or one per lane. Errors-in-variables
    maximum likelihood as in `maximum_likelihood`: covariances pooled over band and record weight the lines, the lines'
    own covariances set standard errors, thresholds of the profile and the fit test. Lanes with nan give nan.
    intervals=False leaves the bounds nan. ValueError when a channel is missing, a band holds no line, mass is not
    positive, or the records differ in lanes.
    """
    masses, shape = _checked(records, bands, mass)
    for i, record in enumerate(records):
        count = np.diff(band_slices(record.frequency, bands), axis=1)[:, 0]
        for b in np.flatnonzero((count > 0) & (count * (record.periods - 1) < len(CHANNELS))):
            raise ValueError(
                f"record {i} has {count[b]} lines of {record.periods} periods in the band {bands[b][0]:g} .. "
                f"{bands[b][1]:g} Hz, too few for the covariance of four channels; widen the band or leave it out"
            )
    size = (len(masses), len(bands))
    found, ends = np.full((*size, 35), np.nan), np.full((*size, 8, 2), np.nan)
    share, condition, fit_p = (np.full(size, np.nan) for _ in range(3))
    factors = np.full((*size, 4), np.nan)
    for b, edges in enumerate(bands):
        lines = _lines(records, edges)
        moments, noise = _moments(lines, masses)
        share[:, b] = noise[:, [0, 1], [0, 1]].sum(-1) / moments[:, [0, 1], [0, 1]].sum(-1)
        condition[:, b], factors[:, b] = _collinearity(lines, moments, noise)
        ok = condition[:, b] <= CONDITION_LIMIT
        some = replace(lines, u=lines.u[ok], own=lines.own[ok])
        # Two starts: the moment estimator freed of noise, and plain least squares.
        starts = np.stack([_row_solutions(moments[ok] - part * noise[ok]) for part in (1, 0)], axis=1)
        found[ok, b], ends[ok, b] = _search(some, masses[ok], starts, level if intervals else None)
        fit_p[ok, b] = _fit_p(found[ok, b, 32:], np.bincount(lines.record), lines.periods)

    def matrices(values: np.ndarray) -> Iterator[np.ndarray]:
        return (part.reshape(*shape, len(bands), 2, 2) for part in (values[..., :4], values[..., 4:]))

    pairs = (found[..., :8], found[..., 8:16], ends[..., 0], ends[..., 1], factors[..., [0, 1, 0, 1, 2, 3, 2, 3]])
    (k, c), (k_se, c_se), (k_low, c_low), (k_high, c_high), (k_factor, c_factor) = map(matrices, pairs)
    informative, identifiable = np.isfinite(ends).all((2, 3)), condition <= CONDITION_LIMIT
    flat = (found[..., 32], fit_p, informative, np.minimum(share, 1.0), condition, identifiable)
    flat = (a.reshape(*shape, len(bands)) for a in flat)
    return PlanarEstimate(k, c, k_se, c_se, k_low, k_high, c_low, c_high, k_factor, c_factor, *flat)


@dataclass(frozen=True, eq=False)
class PlanarLeastSquares:
    """Per lane and band: stiffness N/m and damping N s/m with standard errors, t and significance (two-sided 95 % of
    Student's t), each (..., bands, 2, 2); r2 and r2_adjusted (..., bands, 2) per force axis; condition (..., bands) of
    the columns X, Y, j w X, j w Y as measured, in which noise passes for independent motion."""

    stiffness: np.ndarray
    damping: np.ndarray
    stiffness_se: np.ndarray
    damping_se: np.ndarray
    stiffness_t: np.ndarray
    damping_t: np.ndarray
    stiffness_significant: np.ndarray
    damping_significant: np.ndarray
    r2: np.ndarray
    r2_adjusted: np.ndarray
    condition: np.ndarray


def planar_least_squares(records: Sequence[LineStatistics], bands: np.ndarray, mass: Mass) -> PlanarLeastSquares:
    """Plain least squares on the responses G = (X, Y) / |F| of all records, D eq 5.5-5.9 and Appendix C.

    D drives through one input and divides by its force; here both components are measured and |F| is their magnitude
    on the line. Rows of one axis: Re and Im of G_x (k_xx + j w c_xx) + G_y (k_xy + j w c_xy) = F_x / |F| + m_x w^2 G_x.
    R2 is taken about the mean of the right-hand side; residual variance has 2 n - 4 degrees of freedom, as Appendix C
    counts. Noise on G biases it as it does `least_squares`, and a single excitation is fitted, not refused: see
    condition. Columns that depend on each other to rounding give nan. Arguments and ValueErrors as
    `eight_coefficients`; also when a band holds fewer than three lines.
    """
    masses, shape = _checked(records, bands, mass, fewest=3)
    size = (len(masses), len(bands))
    values, errors = np.full((*size, 4, 2), np.nan), np.full((*size, 4, 2), np.nan)
    r2, adjusted, limit = np.full((*size, 2), np.nan), np.full((*size, 2), np.nan), np.empty(len(bands))
    condition = np.full(size, np.nan)
    for b, edges in enumerate(bands):
        lines = _lines(records, edges)
        table = (_rows(lines, masses) @ lines.u[..., None])[..., 0]
        table = table * (1 / np.linalg.norm(lines.u[..., :2], axis=-1, keepdims=True))
        rows, freedom = 2 * len(lines.w), 2 * len(lines.w) - 4
        ok = np.isfinite(table).all((1, 2))
        table = np.concatenate([table[ok].real, table[ok].imag], axis=1)
        columns, target = table[..., :4], table[..., 4:]
        length = np.linalg.norm(columns, axis=1)
        left, spread, right = np.linalg.svd(columns / np.where(length > 0, length, 1.0)[:, None], full_matrices=False)
        rank = spread > spread[:, :1] * np.finfo(float).eps * table.shape[1]
        inverse = np.swapaxes(right, 1, 2) / (np.where(rank, spread, np.nan)[:, None] * length[:, :, None])
        values[ok, b] = inverse @ (np.swapaxes(left, 1, 2) @ target)
        rss = ((target - columns @ values[ok, b]) ** 2).sum(axis=1)
        errors[ok, b] = np.sqrt((inverse**2).sum(-1)[:, :, None] * rss[:, None] / freedom)
        r2[ok, b] = 1 - rss / ((target - target.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
        adjusted[ok, b] = 1 - (1 - r2[ok, b]) * (rows - 1) / freedom
        condition[ok, b] = np.where(rank.all(-1), spread[:, 0] / spread[:, -1], np.inf)
        limit[b] = special.stdtrit(freedom, 0.975)
    with np.errstate(divide="ignore", invalid="ignore"):  # an exact fit has no standard error
        t = values / errors
    parts = []
    for a in (values, errors, t, np.abs(t) >= limit[:, None, None]):
        # (column, row) to stiffness and damping, each (row, column).
        a = np.swapaxes(a.reshape(*shape, len(bands), 2, 2, 2), -1, -2)
        parts += [a[..., 0, :, :], a[..., 1, :, :]]
    ends = (a.reshape(*shape, len(bands), 2) for a in (r2, adjusted))
    return PlanarLeastSquares(*parts, *ends, condition.reshape(*shape, len(bands)))


@dataclass(frozen=True)
class _Lines:
    """All lines of one band: channels u (lanes, n, 4), covariance own (lanes, n, 4, 4), w rad/s (n,), record (n,) as an
    index into periods (records,), those of the records that have lines here."""

    u: np.ndarray
    own: np.ndarray
    w: np.ndarray
    record: np.ndarray
    periods: np.ndarray

    def per_record(self, values: np.ndarray) -> np.ndarray:
        """Means (lanes, records, ...) over each record's lines of values (lanes, n, ...)."""
        return np.stack([values[:, self.record == r].mean(axis=1) for r in range(len(self.periods))], axis=1)


def _checked(
    records: Sequence[LineStatistics], bands: np.ndarray, mass: Mass, fewest: int = 1
) -> tuple[np.ndarray, tuple[int, ...]]:
    """Masses (lanes, 2) and the lanes' shape."""
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
    lines = sum(np.diff(band_slices(record.frequency, bands), axis=1)[:, 0] for record in records)
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


def _lines(records: Sequence[LineStatistics], edges: np.ndarray) -> _Lines:
    means, covariances, frequencies, periods = [], [], [], []
    for record in records:
        ((start, stop),) = band_slices(record.frequency, edges[None])
        if start == stop:
            continue
        keep, channels = [record.index(name) for name in CHANNELS], len(record.channels)
        mean = record.mean[..., start:stop].reshape(-1, channels, stop - start)[:, keep]
        own = record.covariance[..., start:stop].reshape(-1, channels, channels, stop - start)[:, keep][:, :, keep]
        # A record without noise is weighted as if its force had a relative noise of 1e-9.
        own[:, [0, 1], [0, 1]] += 1e-18 * (np.abs(mean[:, :2]) ** 2).sum(1).mean(-1)[:, None, None]
        means.append(np.moveaxis(mean, -1, 1))
        covariances.append(np.moveaxis(own, -1, 1))
        frequencies.append(record.frequency[start:stop])
        periods.append(record.periods)
    index = np.repeat(np.arange(len(periods)), [f.size for f in frequencies])
    u, own = (np.concatenate(parts, axis=1, dtype=complex) for parts in (means, covariances))
    return _Lines(u, own, 2 * np.pi * np.concatenate(frequencies), index, np.array(periods))


def _rows(lines: _Lines, masses: np.ndarray) -> np.ndarray:
    """What makes X, Y, j w X, j w Y, F_x + m_x w^2 X and F_y + m_y w^2 Y of a line's channels, (lanes, n, 6, 4)."""
    rows = np.zeros((len(masses), len(lines.w), 6, 4), complex)
    for axis in range(2):
        rows[:, :, axis, 2 + axis] = 1.0
        rows[:, :, 2 + axis, 2 + axis] = 1j * lines.w
        rows[:, :, 4 + axis, axis] = 1.0
        rows[:, :, 4 + axis, 2 + axis] = masses[:, axis, None] * lines.w**2
    return rows


def _moments(lines: _Lines, masses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Real second moments (lanes, 6, 6) of what `_rows` makes, each record over its force power, and their noise."""
    power = lines.per_record((np.abs(lines.u[..., :2]) ** 2).sum(-1))
    rows = _rows(lines, masses) * (1 / np.sqrt(power))[:, lines.record, None, None]
    values = (rows @ lines.u[..., None])[..., 0]
    noise = (rows @ lines.own @ np.conj(np.swapaxes(rows, -1, -2))).real.sum(axis=1)
    return np.einsum("lni,lnj->lij", values, np.conj(values)).real, noise


def _row_solutions(moments: np.ndarray) -> np.ndarray:
    """Coefficients (lanes, 8) that the moments give by least squares."""
    k_and_c = np.linalg.solve(moments[:, :4, :4], moments[:, :4, 4:])
    return np.concatenate([np.swapaxes(k_and_c[:, part], 1, 2).reshape(-1, 4) for part in (slice(2), slice(2, 4))], 1)


def _collinearity(lines: _Lines, moments: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Condition number (lanes,) and variance inflation (lanes, 4) of the columns X, Y, j w X, j w Y, freed of noise.

    In a direction that nothing moves in, noise stands for motion, and with its mean taken off what is left is of either
    sign. Its power there over what the covariances say is F-distributed: the condition is infinite unless the power in
    every direction is more than noise reaches with a chance of `_NOISE_LEVEL`.
    """
    power = (np.abs(lines.u[..., :2]) ** 2).sum(-1)
    own = lines.own[..., [2, 3], [2, 3]].real / lines.per_record(power)[:, lines.record, None]
    # Satterthwaite: lines of unequal noise count for fewer; a squared sample variance is P / (P - 1) of the true one.
    periods = lines.periods[lines.record][:, None]
    with np.errstate(divide="ignore", invalid="ignore"):  # without noise
        lines_alike = own.sum(axis=1) ** 2 / (own**2 * (periods - 1) / periods).sum(axis=1)
        periods_alike = own.sum(axis=1) ** 2 / (own**2 / periods).sum(axis=1)
    upper = 2 * np.fmin(lines_alike, len(periods)).min(axis=-1)
    lower = 2 * np.fmin(periods_alike, (periods - 1).sum()).min(axis=-1)
    passing = special.fdtri(upper, lower, 1 - _NOISE_LEVEL)
    condition, factors = np.full(len(moments), np.nan), np.full((len(moments), 4), np.nan)
    some = np.isfinite(moments).all((1, 2)) & np.isfinite(noise).all((1, 2))
    condition[some], factors[some] = np.inf, np.inf
    length = np.sqrt(np.diagonal(moments, axis1=1, axis2=2)[:, :4])
    scale = 1 / np.where(length > 0, length, 1.0)
    moments = moments[:, :4, :4] * scale[:, :, None] * scale[:, None]
    noise = noise[:, :4, :4] * scale[:, :, None] * scale[:, None]
    some[some] = np.linalg.eigvalsh(moments[some] - passing[some, None, None] * noise[some])[:, 0] > 0
    signal = moments[some] - noise[some]
    length = np.sqrt(np.diagonal(signal, axis1=1, axis2=2))
    values, vectors = np.linalg.eigh(signal / length[:, :, None] / length[:, None, :])
    condition[some] = np.sqrt(values[:, -1] / values[:, 0])
    factors[some] = (vectors**2 / values[:, None]).sum(axis=-1)
    return condition, factors


def _search(
    lines: _Lines, masses: np.ndarray, starts: np.ndarray, level: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """What `planar_likelihood.estimate` finds (lanes, 35) and the bounds (lanes, 8, 2), nan without a level."""
    u, own, pooled = (np.ascontiguousarray(a) for a in (lines.u, lines.own, lines.per_record(lines.own)))
    rest = (lines.record, lines.w, masses)
    found, inverses = np.empty((len(masses), 35)), np.empty((len(masses), 8, 8))
    planar_likelihood.estimate(u, pooled, own, *rest, lines.periods, starts, found, inverses)
    ends = np.full((len(masses), 8, 2), np.nan)
    if level is not None:
        threshold = special.stdtrit(found[:, 24:32], (1 + level) / 2) ** 2 / 2 * found[:, 16:24]
        planar_likelihood.bounds(u, pooled, *rest, found, inverses, threshold, ends)
    return found, ends


def _fit_p(found: np.ndarray, count: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """p-value of the cost; found (lanes, 3): cost, what noise alone makes of it, its freedom; count lines per record.

    With weights from the records the cost is a sum of Lawley-Hotelling traces of two complex channels: an F with their
    mean and variance (complex inverse Wishart moments). nan where lines and periods are too few for these.
    """
    cost, expected, freedom = found.T
    most = 4.0 * count.sum() - 8.0
    if most <= 0:
        return np.full(len(found), np.nan)
    inner = count * (periods - 1) * (freedom / most)[:, None]  # of the weights, fewer where lines differ in noise
    outer = count / count.sum() * freedom[:, None] / 4
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = outer * 2 * inner / (inner - 2)
        cubic = (inner - 2) * ((inner - 2) ** 2 - 1)
        first, second = 2 * inner / cubic, (4 * (inner - 2) + 2) / cubic
        variance = (inner**2 * (outer * first + outer**2 * (second - 4 / (inner - 2) ** 2))).sum(-1)
        ratio = variance / mean.sum(-1) ** 2 * freedom
        second_freedom = (2 * freedom - 4 + 4 * ratio) / (ratio - 2)
        scaled = cost / expected * (freedom / 2) / mean.sum(-1) * second_freedom / (second_freedom - 2)
    return np.where((inner > 3).all(-1), special.fdtrc(freedom, second_freedom, scaled), np.nan)
