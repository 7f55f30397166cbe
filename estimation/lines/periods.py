"""Line spectra of periodic records: means over whole periods, their covariance, and how many periods to drop."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

LEAST = 4  # periods whose phases may tell a drift
FAINT = 1e-3  # of the strongest line's power: lines that tell no drift
LEFT = 0.1  # share of a period's power that may be no shifted copy, so that its shift counts
# Share of the power of a shift that may drift otherwise, and standard deviations by which it does so surely.
OTHERWISE, SURELY = 0.1, 8.0
NEGLIGIBLE = 1e-3  # of a channel's amplitudes: a transient that is smaller leaves them as they are
BY_CHANCE = 14.0  # what one of a million pairs of steady periods exceeds, see `two_unsteady`
NEIGHBOURS = 8  # neighbouring lines that are tested for a transient together


@dataclass(frozen=True)
class LineStatistics:
    """Complex amplitudes (peak, cosine convention) of several channels at spectral lines, over P periods.

    Attributes:
        frequency: Frequencies (n,), Hz.
        lines: Harmonic numbers (n,).
        channels: Names of the channels.
        mean: Mean amplitudes (..., channels, n); the leading dimensions are lanes.
        covariance: Covariance of the mean, E[n_a conj(n_b)], (..., channels, channels, n): the sample covariance over
            periods divided by P.
        periods: P.
    """

    frequency: np.ndarray
    lines: np.ndarray
    channels: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray
    periods: int

    def index(self, channel: str) -> int:
        if channel not in self.channels:
            raise ValueError(f"channel {channel!r} is missing; the record has {', '.join(self.channels)}")
        return self.channels.index(channel)

    def amplitude(self, channel: str) -> NDArray[np.complex128]:
        """Mean complex amplitude (..., n)."""
        return self.mean[..., self.index(channel), :]

    def cross(self, a: str, b: str) -> np.ndarray:
        """Covariance of the means of two channels, (..., n); real when a is b."""
        c = np.asarray(self.covariance[..., self.index(a), self.index(b), :], dtype=np.complex128)
        return c.real if a == b else c

    def at_lines(self, lines: Sequence[int] | np.ndarray, channels: Sequence[str] | None = None) -> "LineStatistics":
        """The same statistics at a subset of the lines, and of some channels alone; None: of all."""
        keep = np.flatnonzero(np.isin(self.lines, np.asarray(lines)))
        own = np.arange(len(self.channels)) if channels is None else np.array([self.index(c) for c in channels])
        if len(keep) == len(self.lines) and own.tolist() == list(range(len(self.channels))):
            return self
        return replace(
            self,
            frequency=self.frequency[keep],
            lines=self.lines[keep],
            channels=tuple(self.channels[i] for i in own),
            mean=self.mean[..., own[:, None], keep],
            covariance=self.covariance[..., own[:, None, None], own[:, None], keep],
        )


def held(statistics: LineStatistics, channel: str, sample_rate: float) -> LineStatistics:
    """The statistics with a zero-order-held channel turned into the continuous signal that acts on the plant.

    A force that a converter holds over each sample period T = 1 / sample_rate acts half a sample late: its lines are
    multiplied by sinc(f T) e^(-j pi f T). Without this, the damping of k + j w c would be too large by k T / 2.

    Args:
        statistics: Line statistics.
        channel: The held channel.
        sample_rate: Rate of the converter, Hz.
    """
    return multiplied(statistics, channel, zero_order_hold(statistics.frequency / sample_rate))


def zero_order_hold(x: np.ndarray) -> np.ndarray:
    """Response of a converter that holds its samples, at frequencies in units of its rate."""
    return np.sinc(x) * np.exp(-1j * np.pi * x)


def multiplied(statistics: LineStatistics, channel: str, factor: np.ndarray) -> LineStatistics:
    """The statistics with a channel multiplied by a response (n,), such as that of a known lag or its inverse."""
    i, mean, covariance = statistics.index(channel), statistics.mean.copy(), statistics.covariance.copy()
    mean[..., i, :] *= factor
    covariance[..., i, :, :] *= factor
    covariance[..., :, i, :] *= np.conj(factor)
    return replace(statistics, mean=mean, covariance=covariance)


def period_spectra(signals: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Complex amplitudes (channels, lines) of one period of signals (channels, samples)."""
    n = signals.shape[-1]
    return np.asarray(scipy.fft.rfft(signals, axis=-1))[..., np.asarray(lines)] * (2.0 / n)


def line_statistics(
    spectra: Iterable[np.ndarray], fundamental: float, lines: np.ndarray, channels: tuple[str, ...]
) -> LineStatistics:
    """Mean and covariance over periods, taking one period at a time (Welford).

    Memory does not grow with the number of periods.

    Args:
        spectra: Spectra (..., channels, n), one item per period.
        fundamental: Fundamental frequency, Hz.
        lines: Harmonic numbers (n,).
        channels: Names of the channels.

    Raises:
        ValueError: Fewer than two periods.
    """
    mean = second = None
    count = 0
    for z in spectra:
        count += 1
        if mean is None:
            mean, second = z.copy(), np.zeros((*z.shape[:-1], z.shape[-2], z.shape[-1]), complex)
            continue
        before = z - mean
        mean += before / count
        second += before[..., :, None, :] * np.conj(z - mean)[..., None, :, :]
    if count < 2 or mean is None or second is None:
        raise ValueError(f"{count} whole periods: at least two are needed for a covariance; record longer")
    lines = np.asarray(lines)
    return LineStatistics(lines * fundamental, lines, channels, mean, second / (count - 1) / count, count)


def split_periods(signals: np.ndarray, samples_per_period: int) -> np.ndarray:
    """Whole periods (periods, channels, samples) of signals (channels, total); a remainder at the end is dropped.

    Raises:
        ValueError: Fewer than two whole periods.
    """
    periods = signals.shape[-1] // samples_per_period
    if periods < 2:
        raise ValueError(
            f"{signals.shape[-1]} samples hold {signals.shape[-1] / samples_per_period:.2f} periods of "
            f"{samples_per_period} samples; at least two whole periods are needed"
        )
    whole = signals[:, : periods * samples_per_period]
    return whole.reshape(len(signals), periods, samples_per_period).transpose(1, 0, 2)


def from_middle(count: int) -> np.ndarray:
    """Times (count,) of periods from the middle of all of them, in periods."""
    return np.arange(count) - (count - 1) / 2


def straightened(periods: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The slope per period of values (P, ...) of each period, and the values without their straight line over time."""
    at = from_middle(len(periods))
    slope = np.tensordot(at, periods, 1) / (at @ at)
    return slope, periods - periods.mean(axis=0) - np.multiply.outer(at, slope)


def period_drift(spectra: np.ndarray, w: np.ndarray, at: Sequence[int] | None = None) -> tuple[float, float] | None:
    """Drift of the phases of periods, as of a clock that is not that of the excitation.

    Args:
        spectra: of one channel, (periods, n).
        w: of the lines (n,), radians per sample.
        at: Numbers of the periods, increasing, where some are left out; None: one after the other.

    Returns:
        Samples per period by which the periods run ahead, and the standard error; None where it is not told, or where
        what drifts is no shift: a plant whose gain changes turns the phases of its lines, too.
    """
    if len(spectra) < LEAST:
        return None
    size = np.abs(spectra.mean(axis=0)) ** 2
    loud = size > FAINT * size.max(initial=0.0)
    spectra, w = spectra[:, loud], w[loud]
    middle = spectra[len(spectra) // 2]
    numbers = np.arange(len(spectra)) if at is None else np.asarray(at)
    since, weight = numbers - numbers[len(spectra) // 2], np.abs(middle) ** 2
    # The periods nearest to one another first, so that the phase of no line turns by more than half a turn.
    apart = np.diff(numbers)
    nearest = apart.min()
    turned = (spectra[1:] * spectra[:-1].conj())[apart == nearest].sum(axis=0)
    power = (weight * w**2).sum()
    if not power:
        return None
    first = 0.0
    for some in (w <= np.quantile(w, 1 / 3), np.ones(w.size, bool)):  # low lines turn least
        steps = np.angle(turned * np.exp(-1j * w * first * nearest)) / nearest
        first += float((weight * w * steps)[some].sum() / (weight * w**2)[some].sum())
    rest = np.angle(spectra * np.exp(-1j * np.outer(since * first, w)) * middle.conj())
    shift = (weight * w * rest).sum(axis=1) / power + since * first
    left = np.abs(spectra - middle * np.exp(1j * np.outer(shift, w))) ** 2
    if (left.sum(axis=1) > LEFT * weight.sum()).any():
        return None
    slope, ahead = np.polyfit(since, shift, 1)
    drift, chance = _otherwise(spectra * np.exp(-1j * np.outer(shift, w)), since)
    if drift > max(OTHERWISE * slope**2 * power, SURELY * chance):
        return None
    off = shift - slope * since - ahead
    # Few periods scatter by chance less than the noise of their lines lets them.
    noise = (weight * w**2 * left / 2).sum() / len(since) / power**2
    scatter = max((off**2).sum() / max(len(since) - 2, 1), noise)
    return float(slope), float(np.sqrt(scatter / ((since - since.mean()) ** 2).sum()))


def _otherwise(aligned: np.ndarray, since: np.ndarray) -> tuple[float, float]:
    """Power by which the lines (periods, n), with their shifts taken off, drift per period beyond their noise, and the
    standard deviation of that by noise."""
    time = since - since.mean()
    trend = time @ aligned / (time @ time)
    rest = np.abs(aligned - aligned.mean(axis=0) - np.outer(time, trend)) ** 2
    noise = rest.sum(axis=0) / max(len(since) - 2, 1) / (time @ time)
    return float((np.abs(trend) ** 2 - noise).sum()), float(np.sqrt((noise**2).sum()))


def transient_periods(spectra: np.ndarray, level: float = 1e-3) -> int:
    """Number of leading periods of spectra (periods, n) of one channel that are not yet steady.

    Each leading period is compared with all later ones. For a steady period, |Z_p - mean|^2 over its predicted variance
    is F(2, 2 (q - 1)) distributed at each line, with q later periods, and Fisher's sum over the lines is chi-square.
    The same test over groups of neighbouring lines finds the ringing of a lightly damped mode; the smallest p-value
    counts, corrected for the number of tests. At least three periods are kept, so that what drifts throughout the
    record leaves some, and two of three: a record of two cannot be tested.
    """
    first, least = 0, 3 if len(spectra) > 3 else 2
    while len(spectra) - first > least:
        later = spectra[first + 1 :]
        q = len(later)
        variance = later.var(axis=0, ddof=1) * (1 + 1 / q)
        usable = variance > 0
        if not usable.any():
            return first
        ratio = np.abs(spectra[first] - later.mean(axis=0))[usable] ** 2 / variance[usable]
        fisher = -2 * scipy.stats.f.logsf(ratio, 2, 2 * (q - 1))
        starts = np.arange(0, fisher.size, NEIGHBOURS)
        local = (
            scipy.stats.chi2.sf(np.add.reduceat(fisher, starts), 2 * np.diff(starts, append=fisher.size)).min()
            * starts.size
        )
        if 2 * min(scipy.stats.chi2.sf(fisher.sum(), 2 * fisher.size), local) > level:
            return first
        first += 1
    return first


def two_unsteady(spectra: np.ndarray) -> bool:
    """Whether two periods of one channel, spectra (2, n) at increasing lines, differ by a transient.

    What decays within a period has nearly the same spectrum at neighbouring lines, and noise has not: of n lines,
    n times the squared correlation of the difference with itself one line further is then exponentially distributed.
    """
    difference, size = spectra[0] - spectra[1], np.linalg.norm(spectra)
    power = float(np.linalg.norm(difference)) ** 2
    if difference.size < 2 or power <= (NEGLIGIBLE * size) ** 2:
        return False
    alike = abs(np.vdot(difference[:-1], difference[1:])) / power
    return bool(alike > 0.5 and difference.size * alike**2 > BY_CHANCE)
