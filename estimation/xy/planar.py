"""Stiffness and damping matrices of two coupled axes, F = (K - w^2 diag(m_x, m_y) + j w C) (X, Y), per band.

The dissertation (D) fits the eight coefficients of eq 5.5-5.9 to one excitation. One excitation moves x and y along one
line and reveals only the combination of coefficients along it (`row_sums`); two independent excitations separate the
coefficients. Matrices are indexed (force axis, motion axis): stiffness[..., 0, 1] is k_xy.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from estimation.band_mean import PARTNERS
from estimation.bands import band_slices
from estimation.lines.periods import LineStatistics
from estimation.max_likelihood import BandEstimate, maximum_likelihood
from estimation.normal import reach
from estimation.xy.planar_distortion import distorted
from estimation.xy.planar_lines import CHANNELS, Mass, PlanarLines, checked_masses, equation_rows, planar_lines

CONDITION_LIMIT = 30.0  # Belsley, Kuh and Welsch 1980: above this condition number collinearity does harm
_FORCE_NOISE = 3.0  # times the noise power: a level that the noise of many lines never reaches
_NOISE_LEVEL = 1e-3  # probability that noise alone is taken for motion in an independent direction


@dataclass(frozen=True)
class PlanarEstimate:
    """Estimates per lane and band; stiffness and damping (..., bands, 2, 2), all others (..., bands) unless stated.

    Where the coefficients are not identifiable, everything but condition, inflation and noise share is nan.

    Attributes:
        stiffness: N/m.
        damping: N s/m.
        stiffness_se: Standard error, N/m.
        damping_se: Standard error, N s/m.
        stiffness_low: Lower profile-likelihood bound; -inf where the data do not bound it.
        stiffness_high: Upper bound; inf where the data do not bound it.
        damping_low: Lower bound of the damping.
        damping_high: Upper bound of the damping.
        stiffness_inflation: Variance inflation factors (..., bands, 2, 2), equal in both rows.
        damping_inflation: The same for the damping.
        cost: Cost at the minimum.
        fit_p: p-value of the hypothesis that constant coefficients explain the band.
        informative: Whether all eight intervals are bounded.
        noise_share: Share of the measured |X|^2 + |Y|^2 that is noise.
        condition: Condition number of the columns X, Y, j w X, j w Y, each scaled to length 1 and corrected for noise;
            inf where they cannot be distinguished from noise or all forces act along one direction.
        identifiable: Whether condition <= CONDITION_LIMIT.
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
    """What one excitation reveals: the direct coefficients of each axis, and the motion for which they hold.

    With ratio = Y / X constant over the band, x.stiffness is k_xx + Re(ratio) k_xy - w Im(ratio) c_xy and x.damping is
    c_xx + Re(ratio) c_xy + Im(ratio) k_xy / w; y likewise with 1 / ratio. For x = y they are the row sums.

    Attributes:
        x: One-axis estimate of x.
        y: One-axis estimate of y.
        ratio: Complex ratio Y / X (..., bands).
        ratio_spread: Rms deviation of the lines from ratio, corrected for noise, (..., bands).
    """

    x: BandEstimate
    y: BandEstimate
    ratio: np.ndarray
    ratio_spread: np.ndarray


def axis_statistics(statistics: LineStatistics, axis: Literal["x", "y"]) -> LineStatistics:
    """The channels of one axis under their one-axis names: "force_x" becomes "force".

    The one-axis estimators then give D's direct coefficients (eq 5.10-5.12); the force is the component along the axis.

    Raises:
        ValueError: The axis has no force or no displacement.
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
    """Direct coefficients of both axes from one record; the arguments are those of `eight_coefficients`."""
    masses, shape = checked_masses([statistics], bands, mass)
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
        with np.errstate(divide="ignore", invalid="ignore"):  # x may be at rest
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
    """Minimise sum e^H S^-1 e over the lines of all records in each band, with e = F - Z (X, Y) and its covariance S.

    Errors-in-variables maximum likelihood as in `maximum_likelihood`: covariances pooled over band and record weight
    the lines; the lines' own covariances determine standard errors, profile thresholds and the fit test.

    Args:
        records: Line statistics with the channels `CHANNELS` at their force lines. All have the same lanes; lines and
            periods may differ.
        bands: Bands (b, 2), Hz.
        mass: Moving mass, kg: one value for both axes or a tuple (m_x, m_y), each a scalar or one per lane.
        intervals: False leaves the bounds nan.
        level: Confidence level of the intervals.

    Returns:
        The estimates; lanes that contain nan give nan.

    Raises:
        ValueError: A channel is missing, a band holds no line or too few lines of a record for its covariance
            (lines x (periods - 1) < 4), the mass is not positive, or the records differ in lanes.
    """
    masses, shape = checked_masses(records, bands, mass)
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
    moved = sum((np.abs(r.amplitude(name)) ** 2).sum(-1).reshape(-1) for r in records for name in CHANNELS[2:])
    for b, edges in enumerate(bands):
        lines = planar_lines(records, edges)
        moments, noise = _moments(lines, masses)
        share[:, b] = noise[:, [0, 1], [0, 1]].sum(-1) / moments[:, [0, 1], [0, 1]].sum(-1)
        condition[:, b], factors[:, b] = _collinearity(lines, moments, noise)
        along_one_line = _one_direction(lines)
        condition[along_one_line, b], factors[along_one_line, b] = np.inf, np.inf
        ok = condition[:, b] <= CONDITION_LIMIT
        some = replace(lines, u=lines.u[ok], own=lines.own[ok])
        # Two starting points: the moment estimator corrected for noise, and plain least squares.
        starts = np.stack([_row_solutions(moments[ok] - part * noise[ok]) for part in (1, 0)], axis=1)
        found[ok, b], ends[ok, b] = _search(some, masses[ok], starts, level if intervals else None)
        # Where the law is not linear, once more with what it scatters as noise; cost and fit stay those of the noise.
        rough, excess = distorted(some, masses[ok], found[ok, b, :8])
        bent, excess, first = np.flatnonzero(ok)[excess > 0], excess[excess > 0], starts[excess > 0]
        if bent.size:
            first = np.concatenate([first, found[bent, b, None, :8]], axis=1)
            again, ends[bent, b] = _search(rough, masses[bent], first, level if intervals else None)
            wider = np.sqrt(1 + PARTNERS * excess * (np.abs(rough.u[..., 2:]) ** 2).sum((1, 2)) / moved[bent])[:, None]
            again[:, 8:12] *= wider
            ends[bent, b, :4] = again[:, :4, None] + (ends[bent, b, :4] - again[:, :4, None]) * wider[..., None]
            found[bent, b, :32] = again[:, :32]
        fit_p[ok, b] = _fit_p(found[ok, b, 32:], np.bincount(lines.record), lines.periods)

    def matrices(values: np.ndarray) -> Iterator[np.ndarray]:
        return (part.reshape(*shape, len(bands), 2, 2) for part in (values[..., :4], values[..., 4:]))

    pairs = (found[..., :8], found[..., 8:16], ends[..., 0], ends[..., 1], factors[..., [0, 1, 0, 1, 2, 3, 2, 3]])
    (k, c), (k_se, c_se), (k_low, c_low), (k_high, c_high), (k_factor, c_factor) = map(matrices, pairs)
    informative, identifiable = np.isfinite(ends).all((2, 3)), condition <= CONDITION_LIMIT
    flat = (found[..., 32], fit_p, informative, np.minimum(share, 1.0), condition, identifiable)
    flat = (a.reshape(*shape, len(bands)) for a in flat)
    return PlanarEstimate(k, c, k_se, c_se, k_low, k_high, c_low, c_high, k_factor, c_factor, *flat)


def _moments(lines: PlanarLines, masses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Second moments (lanes, 6, 6) of the `equation_rows`, relative to the force power of each record; their noise."""
    power = lines.per_record((np.abs(lines.u[..., :2]) ** 2).sum(-1))
    rows = equation_rows(lines, masses) * (1 / np.sqrt(power))[:, lines.record, None, None]
    values = (rows @ lines.u[..., None])[..., 0]
    noise = (rows @ lines.own @ np.conj(np.swapaxes(rows, -1, -2))).real.sum(axis=1)
    return np.einsum("lni,lnj->lij", values, np.conj(values)).real, noise


def _one_direction(lines: PlanarLines) -> np.ndarray:
    """Whether the forces of all lines act along one direction, (lanes,).

    Each line then reveals one combination of the coefficients. Only their assumed variation from line to line could
    reveal more, and that is not the purpose of assuming constant coefficients.
    """
    force, own = lines.u[..., :2], lines.own[..., :2, :2]
    scale = 1 / lines.per_record((np.abs(force) ** 2).sum(-1))[:, lines.record]
    moments = np.einsum("lni,lnj,ln->lij", force, np.conj(force), scale).real
    noise = np.einsum("lnij,ln->lij", own, scale).real
    finite = np.isfinite(moments).all((1, 2)) & np.isfinite(noise).all((1, 2))
    one = np.zeros(len(moments), bool)
    values = np.linalg.eigvalsh(moments[finite] - _FORCE_NOISE * noise[finite])
    one[finite] = values[:, 0] < values[:, 1] / CONDITION_LIMIT**2
    return one


def _row_solutions(moments: np.ndarray) -> np.ndarray:
    """Coefficients (lanes, 8) that the moments give by least squares."""
    k_and_c = np.linalg.solve(moments[:, :4, :4], moments[:, :4, 4:])
    return np.concatenate([np.swapaxes(k_and_c[:, part], 1, 2).reshape(-1, 4) for part in (slice(2), slice(2, 4))], 1)


def _collinearity(lines: PlanarLines, moments: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Condition number (lanes,) and variance inflation (lanes, 4) of the columns X, Y, j w X, j w Y without noise.

    In a direction without motion only noise remains, and after its mean is subtracted the rest may have either sign.
    The ratio of the power there to the power that the covariances predict is F-distributed. The condition number is
    infinite unless the power in every direction exceeds what noise reaches with the probability `_NOISE_LEVEL`.
    """
    power = (np.abs(lines.u[..., :2]) ** 2).sum(-1)
    own = lines.own[..., [2, 3], [2, 3]].real / lines.per_record(power)[:, lines.record, None]
    # Satterthwaite: lines of unequal noise count for fewer; the square of a sample variance is P / (P - 1) too large.
    periods = lines.periods[lines.record][:, None]
    with np.errstate(divide="ignore", invalid="ignore"):  # the record may be free of noise
        lines_alike = own.sum(axis=1) ** 2 / (own**2 * (periods - 1) / periods).sum(axis=1)
        periods_alike = own.sum(axis=1) ** 2 / (own**2 / periods).sum(axis=1)
    upper = 2 * np.fmin(lines_alike, len(periods)).min(axis=-1)
    lower = 2 * np.fmin(periods_alike, (periods - 1).sum()).min(axis=-1)
    passing = scipy.special.fdtri(upper, lower, 1 - _NOISE_LEVEL)
    condition, factors = np.full(len(moments), np.nan), np.full((len(moments), 4), np.nan)
    some = np.asarray(np.isfinite(moments).all((1, 2)) & np.isfinite(noise).all((1, 2)))
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
    lines: PlanarLines, masses: np.ndarray, starts: np.ndarray, level: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Output of `planar_likelihood.estimate` (lanes, 35), and the bounds (lanes, 8, 2), nan without a level."""
    from estimation.xy import planar_likelihood  # with the compiler, whose import takes long

    u, own, pooled = (np.ascontiguousarray(a) for a in (lines.u, lines.own, lines.per_record(lines.own)))
    rest = (lines.record, lines.w, masses)
    found, inverses = np.empty((len(masses), 35)), np.empty((len(masses), 8, 8))
    planar_likelihood.estimate(u, pooled, own, *rest, lines.periods, starts, found, inverses)
    ends = np.full((len(masses), 8, 2), np.nan)
    if level is not None:
        threshold = reach(found[:, 24:32], level) ** 2 / 2 * found[:, 16:24]
        planar_likelihood.bounds(u, pooled, *rest, found, inverses, threshold, ends)
    return found, ends


def _fit_p(found: np.ndarray, count: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """p-value of the cost.

    With weights from the records themselves, the cost is a sum of Lawley-Hotelling traces of two complex channels. It
    is approximated by an F distribution of the same mean and variance (complex inverse Wishart moments).

    Args:
        found: Cost, its expectation for noise alone, and its degrees of freedom, (lanes, 3).
        count: Lines per record.
        periods: Periods per record.

    Returns:
        p-values (lanes,); nan where there are too few lines and periods for the moments to exist.
    """
    cost, expected, freedom = found.T
    most = 4.0 * count.sum() - 8.0
    if most <= 0:
        return np.full(len(found), np.nan)
    inner = count * (periods - 1) * (freedom / most)[:, None]  # freedom of the weights; fewer for unequal noise
    outer = count / count.sum() * freedom[:, None] / 4
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = outer * 2 * inner / (inner - 2)
        cubic = (inner - 2) * ((inner - 2) ** 2 - 1)
        first, second = 2 * inner / cubic, (4 * (inner - 2) + 2) / cubic
        variance = (inner**2 * (outer * first + outer**2 * (second - 4 / (inner - 2) ** 2))).sum(-1)
        ratio = variance / mean.sum(-1) ** 2 * freedom
        second_freedom = (2 * freedom - 4 + 4 * ratio) / (ratio - 2)
        scaled = cost / expected * (freedom / 2) / mean.sum(-1) * second_freedom / (second_freedom - 2)
    return np.where((inner > 3).all(-1), scipy.special.fdtrc(freedom, second_freedom, scaled), np.nan)
