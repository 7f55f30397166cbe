"""Frequency responses, noise, coherence and nonlinear distortion from line statistics."""

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.ndimage import uniform_filter1d

from estimation.periods import LineStatistics

_POOL = 7


def frequency_response(statistics: LineStatistics, output: str, source: str) -> tuple[np.ndarray, np.ndarray]:
    """Response output / source and its variance E|n|^2, each (..., n).

    The ratio of period means is the excitation-as-instrument estimate S_yr / S_ur for a periodic excitation r, so
    noise that runs around a loop does not bias it (Pintelon and Schoukens 2012, ch. 2). Lines where the source
    has no power give nan.
    """
    y, u = statistics.amplitude(output), statistics.amplitude(source)
    with np.errstate(divide="ignore", invalid="ignore"):
        g = y / u
        cross = statistics.cross(output, source)
        variance = statistics.cross(output, output) + np.abs(g) ** 2 * statistics.cross(source, source)
        variance = (variance - 2 * np.real(np.conj(g) * cross)) / np.abs(u) ** 2
    return g, variance


def pooled_variance(variance: np.ndarray) -> np.ndarray:
    """Variances (..., n) of a response averaged over seven neighbouring lines.

    A variance from P periods scatters with 2 (P - 1) degrees of freedom; intervals that take it as known undercover.
    """
    return uniform_filter1d(variance, _POOL, axis=-1)


def instrumented_response(output: np.ndarray, source: np.ndarray, instrument: np.ndarray) -> np.ndarray:
    """S_yr / S_ur over the leading axis (periods, realisations): spectra (records, n) each; shape (n,).

    Unbiased where the plain ratio S_yu / S_uu tends to -1 / controller because noise runs around the loop.
    """
    r = np.conj(instrument)
    return (output * r).sum(axis=0) / (source * r).sum(axis=0)


def coherence(statistics: LineStatistics, channel: str) -> np.ndarray:
    """Share of one period's power at each line that repeats in every period, 0..1, shape (..., n).

    |mean|^2 is freed of its own noise: a line of pure noise gives 0 more often than not, and 0.4 / P on average.
    """
    noise = statistics.cross(channel, channel)
    signal = np.maximum(np.abs(statistics.amplitude(channel)) ** 2 - noise, 0.0)
    total = signal + statistics.periods * noise
    return np.divide(signal, total, out=np.zeros_like(total), where=total > 0)


@dataclass(frozen=True)
class Distortion:
    """Repeating power at unexcited lines, relative to the excited lines' rms; None where no such lines exist.

    even, odd: rms amplitude ratios, freed of noise; *_p: p-value that the lines hold noise alone; noise: rms ratio of
    the noise on the mean.
    """

    even: float | None
    odd: float | None
    even_p: float | None
    odd_p: float | None
    noise: float


def distortion(statistics: LineStatistics, channel: str, excited: np.ndarray) -> Distortion:
    """Even and odd nonlinear distortion of one record (no leading dimensions) from its detection lines.

    Detection lines are those of `statistics` that are not in `excited`. Null: per line |mean|^2 / var is
    F(2, 2(P-1)); Fisher's sum over the lines.
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
        fisher = -2 * stats.f.logsf(f, 2, 2 * (statistics.periods - 1)).sum()
        return float(excess), float(stats.chi2.sf(fisher, 2 * usable.sum()))

    odd = statistics.lines % 2 == 1
    even_level, even_p = group(~odd & ~is_excited)
    odd_level, odd_p = group(odd & ~is_excited)
    return Distortion(even_level, odd_level, even_p, odd_p, float(np.sqrt(noise[is_excited].mean()) / level))
