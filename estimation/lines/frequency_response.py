"""Frequency responses, noise, coherence and nonlinear distortion from line statistics."""

from dataclasses import dataclass

import numpy as np
import scipy

from estimation.lines.curves import smooth_response
from estimation.lines.periods import LineStatistics
from estimation.normal import variance_of_difference

POOL = 7  # neighbouring lines whose noise is averaged
LOCAL, CURVE = 6, 4  # neighbouring lines through which a cubic of log frequency is laid
ROUGH_POOL = 41  # lines of whose scatter about the cubics the median is taken, so that a resonance is not distortion
# The median of that many overlapping cubics tells the scatter with about 8 degrees of freedom: the square of Student's
# 95 % quantile over that of a known variance.
FEW = 1.3
CHANCE = 1.25  # ratio of scatter to noise to which noise alone comes too often to count


def frequency_response(statistics: LineStatistics, output: str, source: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequency response of one channel to another, and its variance.

    The ratio of period means equals the estimate S_yr / S_ur with the periodic excitation r as instrument, so noise
    that runs around a control loop does not bias it (Pintelon and Schoukens 2012, ch. 2).

    Returns:
        response: Output / source (..., n); nan at lines where the source has no power.
        variance: Noise variance E|n|^2 of the response (..., n).
    """
    y, u = statistics.amplitude(output), statistics.amplitude(source)
    with np.errstate(divide="ignore", invalid="ignore"):
        g = y / u
        noise = (statistics.cross(a, b) for a, b in ((output, output), (source, source), (output, source)))
        variance = variance_of_difference(*noise, g) / np.abs(u) ** 2
    if not u.all():
        g, variance = np.where(u == 0, np.nan, g), np.where(u == 0, np.nan, variance)
    return g, variance


def mean_of_neighbours(values: np.ndarray, lines: int) -> np.ndarray:
    """Values (..., n), real or complex, averaged over that many neighbouring lines, an odd number.

    Values that are not finite stay as they are and are left out of the means of the others. Each mean is a sum of its
    own: a running one would carry the rounding of a large value to all later lines.
    """
    weights = np.full(lines, 1 / lines)
    if np.isfinite(values.sum()):
        return scipy.ndimage.convolve1d(values, weights, axis=-1)
    known = np.isfinite(values)
    with np.errstate(invalid="ignore"):  # a line without any known neighbour is not known
        mean = scipy.ndimage.convolve1d(np.where(known, values, 0.0), weights, axis=-1)
        mean = mean / scipy.ndimage.convolve1d(known.astype(float), weights, axis=-1)
    return np.where(known, mean, values)


def pooled_variance(variance: np.ndarray) -> np.ndarray:
    """Variances (..., n) of a response, averaged over seven neighbouring lines.

    A variance estimated from P periods scatters with 2 (P - 1) degrees of freedom; intervals that treat it as exact
    cover too little.
    """
    return mean_of_neighbours(variance, POOL)


def loop_variance(frequency: np.ndarray, sensitivity: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Variance of a measured sensitivity, from the scatter over periods and from that between neighbouring lines.

    The noise is averaged as in `pooled_variance`, but in proportion to |S|^2, as noise at one place of the loop enters
    S, unless a line has far more than its neighbours. What repeats with the period but scatters from line to line about
    a smooth loop gain is stochastic nonlinear distortion (Pintelon and Schoukens 2012, ch. 4), and counts where it
    exceeds the noise.

    Args:
        frequency: (n,), Hz, increasing.
        sensitivity: (n,).
        variance: (n,), of its noise, E|n|^2.
    """

    def noise_of(size: np.ndarray) -> np.ndarray:
        # The scatter of single lines is uncertain, so that of seven is averaged. Where one line has noise that the
        # others lack (a tone, or a resonance of the floor that is narrower than the spacing of the lines), the mean
        # gives it a seventh of its noise. What it has over the mean of its neighbours is then the better estimate.
        # Of white noise a line exceeds twice the mean of seven too rarely to matter, even over two periods.
        own = variance / size
        pooled = pooled_variance(own)
        return np.maximum(pooled, (own - pooled) * POOL / (POOL - 1)) * size

    size = np.abs(sensitivity) ** 2
    total = noise_of(size)
    if frequency.size < LOCAL or not np.any(total):
        return total
    # A line that noise or distortion made large is not less certain for that: its size is that of a smooth loop gain
    # L = 1 / S - 1, |dL| = |dS| / |S|^2, the second time of one that also knows the distortion.
    for _ in range(2):
        smooth = 1 + smooth_response(frequency, 1 / sensitivity - 1, total / size**2)
        size = 1 / np.abs(smooth) ** 2
        inside = np.abs(smooth * (smooth - 1)) ** 2  # dS = (1 - S) d of a disturbance d in proportion to the injection
        total = distorted_variance(frequency, 1 / sensitivity, noise_of(size) / size**2, inside) * size**2
    return total


def distorted_variance(
    frequency: np.ndarray, curve: np.ndarray, variance: np.ndarray, inside: np.ndarray
) -> np.ndarray:
    """Variance (..., n) of smooth curves, with what scatters from line to line more than noise does.

    Distortion enters as noise does, where a reading is not linear, or as a disturbance inside the rig does, where its
    forces are not, whichever is likelier.

    Args:
        frequency: (n,), Hz, increasing, n >= LOCAL.
        curve: (..., n).
        variance: Of its noise, E|noise|^2, (..., n).
        inside: Variance in proportion to that which a disturbance inside the rig would have, (..., n).
    """
    x, n = np.log(frequency), frequency.size - LOCAL + 1
    whole = np.lib.stride_tricks.sliding_window_view
    # What is left of LOCAL lines beside every cubic: an orthogonal basis of as many numbers as there are freedoms.
    places = whole(x, LOCAL)
    cubics = np.stack([np.vander(p - p.mean(), CURVE) for p in places])
    beside = np.linalg.qr(cubics, mode="complete")[0][..., CURVE:]
    left = np.abs(np.einsum("...wl,wlk->...wk", whole(curve, LOCAL, axis=-1), beside)) ** 2

    def beside_of(power: np.ndarray) -> np.ndarray:
        return np.einsum("...wl,wlk->...wk", whole(power, LOCAL, axis=-1), beside**2)

    largest = variance.max(axis=-1, keepdims=True)
    noise = np.where(
        largest > 0, np.maximum(variance, 1e-12 * largest), 1.0
    )  # who calls keeps none where there is none
    of_noise = beside_of(noise)
    around = [(0, 0)] * (curve.ndim - 1) + [(LOCAL // 2, frequency.size - n - LOCAL // 2)]
    freedom = 2 * (LOCAL - CURVE)
    median = 2 * scipy.special.gammaincinv(freedom / 2, 0.5) / freedom  # of that scatter, for noise alone
    width = (1,) * (curve.ndim - 1) + (ROUGH_POOL,)
    best, least = noise, np.inf
    for shape in (noise, inside):
        of_shape = beside_of(shape)
        excess = ((left / median - CHANCE * of_noise) / of_shape).mean(axis=-1)
        share = FEW * np.maximum(scipy.ndimage.median_filter(excess, width), 0.0)
        expected = of_noise + share[..., None] * of_shape
        # Of Student's t with two degrees of freedom: where a resonance bends, a few cubics leave far more.
        unlikely = (np.log(expected) + 2 * np.log1p(left / expected)).sum(axis=(-1, -2))[..., None]
        found = variance + np.pad(share, around, mode="edge") * shape
        best, least = np.where(unlikely < least, found, best), np.minimum(unlikely, least)
    return best


def instrumented_response(output: np.ndarray, source: np.ndarray, instrument: np.ndarray) -> np.ndarray:
    """Response estimated with an instrument, S_yr / S_ur, from several records.

    It is unbiased where noise runs around a control loop; there the plain ratio S_yu / S_uu tends to -1 / controller.

    Args:
        output: Spectra of the output (records, n); the records are periods or realisations.
        source: Spectra of the source (records, n).
        instrument: Spectra of the excitation (records, n).

    Returns:
        The response (n,).
    """
    r = np.conj(instrument)
    return (output * r).sum(axis=0) / (source * r).sum(axis=0)


def coherence(statistics: LineStatistics, channel: str) -> np.ndarray:
    """Share of one period's power at each line that repeats in every period, 0 to 1, shape (..., n).

    The expected noise power is subtracted from |mean|^2, so a line of pure noise gives 0 more often than not, and
    0.4 / P on average over P periods.
    """
    noise = statistics.cross(channel, channel)
    signal = np.maximum(np.abs(statistics.amplitude(channel)) ** 2 - noise, 0.0)
    total = signal + statistics.periods * noise
    return np.divide(signal, total, out=np.zeros_like(total), where=total > 0)


@dataclass(frozen=True)
class Distortion:
    """Repeating power at lines that are not excited, relative to the excited lines' rms amplitude.

    Attributes:
        even: Rms amplitude ratio at even lines, corrected for noise; None where no such lines exist.
        odd: The same at odd lines.
        even_p: p-value of the hypothesis that the even lines hold noise alone; None where it cannot be tested.
        odd_p: The same at odd lines.
        noise: Ratio of the rms noise on the mean.
    """

    even: float | None
    odd: float | None
    even_p: float | None
    odd_p: float | None
    noise: float


def distortion(statistics: LineStatistics, channel: str, excited: np.ndarray) -> Distortion:
    """Even and odd nonlinear distortion of one record, from its detection lines.

    The test for each line is |mean|^2 / variance, which is F(2, 2 (P - 1)) distributed for noise alone; Fisher's sum
    combines the lines.

    Args:
        statistics: Line statistics without leading dimensions. Their lines that are not in `excited` are the
            detection lines.
        channel: Channel to be examined.
        excited: Excited lines.
    """
    is_excited = np.isin(statistics.lines, excited)
    power = np.abs(statistics.amplitude(channel)) ** 2
    noise = statistics.cross(channel, channel)
    level = np.sqrt(power[is_excited].mean())

    def group(mask: np.ndarray) -> tuple[float | None, float | None]:
        if not mask.any():
            return None, None
        excess = np.sqrt(max(float((power - noise)[mask].mean()), 0.0)) / level
        usable = mask & (noise > 0)
        if not usable.any():
            return float(excess), None
        f = power[usable] / noise[usable]
        fisher = -2 * scipy.stats.f.logsf(f, 2, 2 * (statistics.periods - 1)).sum()
        return float(excess), float(scipy.stats.chi2.sf(fisher, 2 * usable.sum()))

    odd = statistics.lines % 2 == 1
    even_level, even_p = group(~odd & ~is_excited)
    odd_level, odd_p = group(odd & ~is_excited)
    return Distortion(even_level, odd_level, even_p, odd_p, float(np.sqrt(noise[is_excited].mean()) / level))
