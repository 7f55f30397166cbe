"""Tones between the harmonics of periodic records: found, removed, and what they leave uncertain on a line nearby."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from estimation.lines.periods import LineStatistics, from_middle, split_periods, straightened

FALSE_ALARM = 1e-5  # probability that noise alone shows a tone somewhere in a record
NEIGHBOURS = 25  # bins on either side above which a tone must stand out
MOST = 8  # tones per record
REACH, FURTHER = 0.7, 1.0  # bins, see `remove_tones`
ON_LINE = 0.01  # bins from a line within which a tone is the same to it
CLOSE = 8  # bins around a tone that hold no more than noise once it is removed
HALF = 0.5  # bins of a period, from a line to where another one is nearer
ROUNDING = 1e-12  # of a reading, below which its noise is not to be compared with anything
PART = 0.3  # of an excited line, that what it grows or fades by may be beside it
ALIKE = 0.25  # of the relative growth of a line, from which another one grows alike
LEAKS = 10.0  # times a tone's chi-square that it must have beside the noise without it for it to hide that noise
GROWN = 5.0  # standard deviations by which a line must grow or fade over the periods to do so
BESIDE, SWEEPS = 4.0, 12  # bins within which tones take from each other, and rounds in which these are fitted again


@dataclass(frozen=True)
class Tone:
    """A sinusoid in a record.

    Attributes:
        frequency: Hz.
        amplitude: Complex amplitudes (axes,) by channel.
        chi2: Power of the displacement over that of its noise, of each axis over its own, as a chi-square of two
            degrees of freedom per axis.
    """

    frequency: float
    amplitude: Mapping[str, np.ndarray]
    chi2: float


def remove_tones(
    channels: Mapping[str, np.ndarray], per_period: int, rate: float, reach: float = REACH
) -> tuple[dict[str, np.ndarray], list[Tone]]:
    """Remove the tones that lie between the harmonics.

    Args:
        channels: Whole periods (axes, samples) by channel.
        per_period: Samples per period.
        rate: Sampling rate, Hz.
        reach: Bins from where a tone shows within which it is looked for: one beside a harmonic shows on the next bin,
            but a gain that drifts shows beside every harmonic, and would be taken for tones.

    Returns:
        The channels without the tones, and the tones.
    """
    cleaned = {name: values.copy() for name, values in channels.items()}
    total = cleaned["displacement"].shape[1]
    bins: list[float] = []  # of the whole record, where tones are
    chi2: list[float] = []
    amplitudes: list[dict[str, np.ndarray]] = []
    weights: list[np.ndarray] = []  # of each axis, by its noise there
    first: list[float] = []  # squared sizes, so weighted, as they were found

    def size(i: int) -> float:
        return float((weights[i] * abs(amplitudes[i]["displacement"]) ** 2).sum())

    def shift(i: int, sign: float) -> None:
        """Take a tone away, or put it back."""
        phase = np.exp(2j * np.pi * bins[i] * np.arange(total) / total)
        for name, values in cleaned.items():
            values += sign * (amplitudes[i][name][:, None] * phase).real

    while len(bins) < MOST:
        peak = _strongest(cleaned["displacement"], per_period)
        if peak is None:
            break
        bins.append(peak[0])
        chi2.append(peak[1])
        weights.append(peak[2])
        amplitudes.append({name: np.zeros(len(values), complex) for name, values in cleaned.items()})
        # Tones that are hardly apart take from each other: each is fitted again beside the others (J. Li and P. Stoica,
        # IEEE Transactions on Signal Processing 44, 1996).
        beside = [i for i, b in enumerate(bins) if abs(b - bins[-1]) < BESIDE]
        for _ in range(SWEEPS if len(beside) > 1 else 1):
            for i in reversed(beside):
                shift(i, 1.0)
                bins[i], amplitudes[i] = _refined(cleaned, bins[i], weights[i], per_period, reach)
                shift(i, -1.0)
                if i == len(first):
                    first.append(size(i))
    if not bins:
        return cleaned, []
    # What a neighbour had lent to a tone is no evidence of it.
    chi2 = [c * size(i) / was for i, (c, was) in enumerate(zip(chi2, first, strict=True))]
    least = _significant(total // 2, len(cleaned["displacement"]))
    sizes = [a["displacement"] for a in amplitudes]
    fading = _fading(channels["displacement"], bins, sizes, per_period)
    believed = [c >= least and i not in fading for i, c in enumerate(chi2)]
    for i, tone in enumerate(believed):
        if not tone:
            shift(i, 1.0)
    # A tone off its bin leaks into all others, and hides there how quiet the record is.
    own, _, level = _around(cleaned["displacement"], per_period)
    without = [_power_over(level[:, np.argmin(abs(own - b))], a, total) for b, a in zip(bins, sizes, strict=True)]
    chi2 = [w if w > LEAKS * c else c for c, w in zip(chi2, without, strict=True)]
    found = zip(bins, amplitudes, chi2, believed, strict=True)
    return cleaned, [Tone(b * rate / total, a, c) for b, a, c, tone in found if tone]


def _power_over(level: np.ndarray, amplitude: np.ndarray, total: int) -> float:
    """Power of a tone of an amplitude (axes,) over that of the noise of a bin (axes,), as `Tone.chi2`."""
    return float((2 * abs(amplitude * total / 2) ** 2 / level).sum())


def _fading(values: np.ndarray, bins: Sequence[float], sizes: Sequence[np.ndarray], per_period: int) -> set[int]:
    """Which of the tones, at bins of the whole record and of sizes (axes,), are excited lines that grow or fade.

    What a gain that drifts adds to a line lies within a bin of it, and is a share of it. Several lines have it, where a
    tone beside a line is beside that one alone.

    Args:
        values: The channel (axes, samples) with the tones.
        bins, sizes: Of the tones.
        per_period: Samples per period.
    """
    count = values.shape[1] // per_period
    if count <= 2:
        return set()
    lines = 2 / per_period * np.asarray(scipy.fft.rfft(split_periods(values, per_period), axis=-1))
    (slope, rest), mean, at = straightened(lines), lines.mean(axis=0), from_middle(count)
    sd = np.sqrt((abs(rest) ** 2).sum(axis=0) / (count - 2) / (at @ at))
    # A line that is not excited has no more than its slope; one that is has far more.
    grown = (abs(slope) > GROWN * sd) & (count * abs(slope) < abs(mean))
    growth = np.where(grown, abs(slope) / np.where(mean == 0, 1.0, abs(mean)), 0.0).max(axis=0)
    near = set()
    for i, (b, size) in enumerate(zip(bins, sizes, strict=True)):
        line = round(b / count)
        beyond = abs(size) * np.sqrt(1 - np.sinc(b - count * line) ** 2)  # what the line itself has not taken up
        # What a tone beside one line leaks into others is a small part of these.
        alike = growth[line] > 0 and (growth > ALIKE * growth[line]).sum() > 1
        if alike and abs(b - count * line) < 1.0 and (beyond < PART * abs(mean[:, line])).all():
            near.add(i)
    return near


def _significant(bins: int, axes: int) -> float:
    """Chi-square that noise alone hardly ever shows in any of so many bins."""
    return float(scipy.stats.chi2.isf(FALSE_ALARM / bins, 2 * axes)) * 1.5


def _refined(
    channels: Mapping[str, np.ndarray], at: float, weights: np.ndarray, per_period: int, reach: float
) -> tuple[float, dict[str, np.ndarray]]:
    """Bin and amplitudes of the tone near a bin; `weights` are those of the axes."""
    total = channels["displacement"].shape[1]
    rest = _without_period(channels["displacement"], per_period)
    refined = scipy.optimize.minimize_scalar(
        lambda f: -float(weights @ _energy(rest, f, per_period, total)),
        bounds=(at - reach, at + reach),
        method="bounded",
        options={"xatol": 1e-4},
    ).x
    own = {name: _without_period(values, per_period) for name, values in channels.items()}
    return refined, {name: _amplitude(values, refined, per_period, total) for name, values in own.items()}


def _without_period(values: np.ndarray, per_period: int) -> np.ndarray:
    periods = values.reshape(len(values), -1, per_period)
    return (periods - periods.mean(axis=1, keepdims=True)).reshape(values.shape)


def _strongest(values: np.ndarray, per_period: int) -> tuple[float, float, np.ndarray] | None:
    """Bin (of the whole record) of the strongest significant tone between harmonics, its chi-square, and weights
    (axes,) in proportion to one over the noise of each axis there."""
    total = values.shape[1]
    count = total // per_period
    if count < 3:
        return None
    bins, p, level = _around(values, per_period)
    ratio = (2 * p / level).sum(axis=0)
    at = int(np.argmax(ratio))
    if ratio[at] < _significant(ratio.size, len(values)):
        return None
    return float(bins[at]), float(ratio[at]), level[:, at].min() / level[:, at]


def _around(values: np.ndarray, per_period: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bins between the harmonics, their power along each axis (axes, n), and the power of the noise around them."""
    count = values.shape[1] // per_period
    power = abs(np.fft.rfft(_without_period(values, per_period), axis=1)) ** 2
    between = np.arange(power.shape[1]) % count != 0
    between[: count // 2] = False  # slow drift is not a tone
    p = power[:, between]
    middle = np.stack([scipy.ndimage.median_filter(own, 2 * NEIGHBOURS + 1, mode="reflect") for own in p])
    rounding = ROUNDING**2 * (values**2).sum(axis=1, keepdims=True)
    # Each axis has its own noise: that of the louder one would hide a tone of the other.
    level = np.maximum(middle / (scipy.stats.chi2.median(2) / 2), rounding)
    silent = np.where(level > 0, level, np.inf).min(initial=np.inf)  # an axis without any reading hides nothing
    return np.flatnonzero(between), p, np.where(level > 0, level, silent if np.isfinite(silent) else 1.0)


def tone_at(values: np.ndarray, frequency: float, per_period: int, rate: float) -> tuple[np.ndarray, float]:
    """Amplitude of values (axes, samples) at a frequency between the harmonics.

    Returns:
        amplitude: Complex amplitudes (axes,).
        chi2: Their power over that of the surrounding noise, as `Tone.chi2`.
    """
    total = values.shape[1]
    bins, _, level = _around(values, per_period)
    at = frequency * total / rate
    amplitude = _amplitude(_without_period(values, per_period), at, per_period, total)
    noise = level[:, int(np.argmin(abs(bins - at)))]
    return amplitude, _power_over(noise, amplitude, total)


def _columns(frequency: float, per_period: int, total: int) -> np.ndarray:
    phase = 2 * np.pi * frequency * np.arange(total) / total
    return _without_period(np.array([np.cos(phase), np.sin(phase)]), per_period)


def _fit(rest: np.ndarray, frequency: float, per_period: int, total: int) -> tuple[np.ndarray, np.ndarray]:
    columns = _columns(frequency, per_period, total)
    right = columns @ rest.T
    return np.linalg.lstsq(columns @ columns.T, right, rcond=1e-9)[0], right


def _energy(rest: np.ndarray, frequency: float, per_period: int, total: int) -> np.ndarray:
    coefficients, right = _fit(rest, frequency, per_period, total)
    return (coefficients * right).sum(axis=0)


def _amplitude(rest: np.ndarray, frequency: float, per_period: int, total: int) -> np.ndarray:
    coefficients, _ = _fit(rest, frequency, per_period, total)
    return coefficients[0] - 1j * coefficients[1]


def stands_alone(cleaned: np.ndarray, tone: Tone, per_period: int, rate: float) -> bool:
    """Whether nothing but noise is left around a tone: beside noise through a resonance that is nearly a line, much is.

    Args:
        cleaned: Displacements (axes, samples) without the tone.
        tone: What was removed.
        per_period: Samples per period.
        rate: Sampling rate, Hz.
    """
    bins, power, _ = _around(cleaned, per_period)
    total = cleaned.shape[1]
    close = np.argsort(abs(bins - tone.frequency * total / rate))[:CLOSE]
    level = np.maximum(power[:, close].mean(axis=1), np.finfo(float).tiny)
    size = _power_over(level, tone.amplitude["displacement"], total)
    return size >= _significant(total // 2, len(cleaned))


def beside_tone(
    statistics: LineStatistics, tone: Tone, amplitude: np.ndarray, shown: Sequence[int], duration: float
) -> LineStatistics:
    """Statistics of a record without a tone, with what that leaves uncertain at the line nearest to it.

    Over P periods a line S and a tone that turns by the angle t per period are S + B e^(j p t): the nearer the tone
    lies to the line, the less they are told apart, and the more an error of its frequency moves the line. Both are
    those of least squares. Lines further away are moved by the product of the tone and its distance from the nearest
    line, which the scatter over periods tells well.

    Args:
        statistics: Of one record (channels, n).
        tone: What was removed.
        amplitude: Its amplitudes (channels,).
        shown: Channels by which its frequency was told.
        duration: Of one of the P periods, s: a multiple of that of the excitation where this is no whole number of
            samples. A tone nearer to a line of such a period that is no line of the excitation is beside none.
    """
    at = int(np.argmin(abs(statistics.frequency - tone.frequency)))
    away = abs(tone.frequency - statistics.frequency[at]) * duration
    if away > HALF:
        return statistics
    p = np.arange(statistics.periods) - (statistics.periods - 1) / 2
    off = max(away, ON_LINE / p.size)
    both = np.stack([np.ones(p.size), np.exp(2j * np.pi * off * p)], axis=1)
    apart = 1 / (1 - abs(both.mean(axis=0)[1]) ** 2)
    moved, *_ = np.linalg.lstsq(both, p * both[:, 1], rcond=None)
    left = np.sum(abs(p * both[:, 1] - both @ moved) ** 2)
    # The tone has taken its part of the scatter: one of the P - 1 that a mean leaves.
    noise = statistics.covariance[..., at] * (p.size - 1) / (p.size - 2)
    size = abs(amplitude[shown]) ** 2
    turned = p.size * np.sum(size * noise[shown, shown].real) / (2 * left * size.sum() ** 2)  # variance of t, rad^2
    covariance = statistics.covariance.copy()
    covariance[..., at] = noise * apart + abs(moved[0]) ** 2 * turned * np.outer(amplitude, amplitude.conj())
    return replace(statistics, covariance=covariance)
