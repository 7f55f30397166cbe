"""What measured responses differ from a fitted rig's by: a Gaussian process over the logarithm of the frequency."""

from collections.abc import Sequence

import numpy as np
import scipy

from tuning.campaign.gain_set import Response

# The relative difference between measured and fitted response is a sum of two such processes. Standard deviation and
# length (of ln f) of the first are among these, by their marginal likelihoods. The second is always there: no linear
# model of few parameters is better than SMOOTH_ERROR, and lines that noise hides do not show it. Lags of the same sum
# are not alike: poles of 0.02 and 0.11 ms, and one of 0.12 ms, differ by 2 % at 650 Hz, so errors rise by FORM times
# the square of frequency times sum.
DEVIATIONS, LENGTHS = (0.003, 0.01, 0.03, 0.1, 0.3), (0.03, 0.1, 0.3, 1.0)
SMOOTH_ERROR, SMOOTH_LENGTH, FORM, MOST_ERROR = 0.015, 0.7, 0.03, 0.2
LEAST = 0.02  # probability below which a standard deviation and length are left out
MOST_LINES = 200  # more are averaged in bins of the logarithm of the frequency
CHANCE = 1e-4  # that noise alone moves any line so far from the smooth difference that its measurement stands instead

Kind = tuple[float, float]  # standard deviation and length of ln f


def places(every: np.ndarray, some: np.ndarray) -> np.ndarray:
    """Places of some frequencies among all, which are rounded likewise."""
    return np.searchsorted(every, np.round(some, 9))


def agreed(parts: Sequence[Response]) -> Response | None:
    """Several measurements of one response; its variance is larger where they differ by more than their noise."""
    if not parts:
        return None
    frequency, at = np.unique(np.round(np.concatenate([p.frequency for p in parts]), 9), return_inverse=True)
    value, variance = (np.concatenate([getattr(p, name) for p in parts]) for name in ("value", "variance"))
    variance = np.maximum(variance, (1e-6 * np.abs(value)) ** 2)
    weight = 1 / variance
    total = np.bincount(at, weight)
    mean = (np.bincount(at, weight * value.real) + 1j * np.bincount(at, weight * value.imag)) / total
    more = value.size - frequency.size
    scatter = float((weight * np.abs(value - mean[at]) ** 2).sum() / more) if more else 1.0
    return Response(frequency, mean, max(1.0, scatter) / total)


def binned(ratio: np.ndarray, variance: np.ndarray, frequency: np.ndarray) -> tuple[np.ndarray, ...]:
    """Ratios (draws, n) over fewer frequencies: means by inverse variance over bins of ln f."""
    if frequency.size <= MOST_LINES:
        return ratio, variance, np.log(frequency)
    edges = np.linspace(np.log(frequency[0]), np.log(frequency[-1]) + 1e-9, MOST_LINES + 1)
    _, at = np.unique(np.digitize(np.log(frequency), edges), return_inverse=True)
    weight = 1 / variance
    total = np.bincount(at, weight)
    mean = np.array([
        (np.bincount(at, weight * r.real) + 1j * np.bincount(at, weight * r.imag)) / total for r in ratio
    ])  # fmt: skip
    return mean, 1 / total, np.bincount(at, weight * np.log(frequency)) / total


def differences(
    measured: Response,
    model: np.ndarray,
    every: np.ndarray,
    wanted: np.ndarray,
    lag: float,
    rng: np.random.Generator,
    known: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Relative difference (draws, w) of the true response from each draw's model, at frequencies wanted (w,), Hz.

    The model is (draws, n) at frequencies every (n,), those of the measurement among them; its lags sum up to `lag`, s.

    Draws by Matheron's rule: a path of the prior, corrected by what the measurement says of it. How large and how long
    the differences are is itself drawn by its likelihood; the first draw takes the likeliest. At lines that no such
    path can follow, as at the resonance of a support, the measurement itself stands, with its noise. Their frequencies
    are returned, too; with known ones, those are taken.
    """
    at = places(every, measured.frequency)
    whole, noisy = measured.value / model[:, at] - 1, measured.variance / np.abs(model[0, at]) ** 2
    ratio, variance, place = binned(whole, noisy, measured.frequency)
    kinds, weights = likely(ratio[0], variance, place, lag)
    which = rng.choice(len(kinds), len(ratio), p=weights)
    which[0] = int(weights.argmax())
    everywhere = np.concatenate([place, np.log(wanted)])
    m = place.size
    normal, noise = circular(rng, len(ratio), everywhere.size), circular(rng, len(ratio), m) * np.sqrt(variance)
    normal[0], noise[0] = 0.0, 0.0
    found = np.empty((len(ratio), wanted.size), complex)
    for kind in np.unique(which):
        own = which == kind
        k = covariance(everywhere, kinds[kind], lag)
        path = normal[own] @ root(k).T
        left = ratio[own] - path[:, :m] - noise[own]
        found[own] = path[:, m:] + left @ np.linalg.solve(k[:m, :m] + np.diag(variance), k[:m, m:])
    both, line, here = np.intersect1d(np.round(measured.frequency, 9), wanted, return_indices=True)
    missed = np.abs(whole[0, line] - found[0, here]) ** 2 / noisy[line]
    sharp = missed > np.log(max(both.size, 1) / CHANCE) if known is None else np.isin(both, known)
    line, here = line[sharp], here[sharp]
    scatter = circular(rng, len(whole), line.size) * np.sqrt(noisy[line])
    scatter[0] = 0.0
    found[:, here] = whole[:, line] + scatter
    return found, both[sharp]


def likely(ratio: np.ndarray, variance: np.ndarray, place: np.ndarray, lag: float) -> tuple[list[Kind], np.ndarray]:
    """(standard deviation, length) of the differences, and their probabilities, for which LEAST is the smallest."""
    kinds = [(sd, length) for length in LENGTHS for sd in DEVIATIONS]
    values = []
    for kind in kinds:
        factor = scipy.linalg.cho_factor(covariance(place, kind, lag) + np.diag(variance), lower=True)
        fit = float(np.real(np.conj(ratio) @ scipy.linalg.cho_solve(factor, ratio)))
        values.append(-fit - 2 * float(np.log(np.diag(factor[0])).sum()))
    weights = np.exp(np.array(values) - max(values))
    weights[weights < LEAST * weights.sum()] = 0.0
    return kinds, weights / weights.sum()


def covariance(place: np.ndarray, kind: Kind, lag: float) -> np.ndarray:
    """Covariance (n, n) of relative differences at places ln f (n,), of a model whose lags sum up to a time, s."""
    sd, length = kind
    squared = (place[:, None] - place) ** 2
    own = np.minimum(SMOOTH_ERROR + FORM * (2 * np.pi * np.exp(place) * lag) ** 2, MOST_ERROR)
    always = own[:, None] * own * np.exp(-0.5 * squared / SMOOTH_LENGTH**2)
    return sd**2 * np.exp(-0.5 * squared / length**2) + always


def smooth(frequency: np.ndarray, draws: int, length: float, rng: np.random.Generator) -> np.ndarray:
    """Smooth complex paths (draws, n) of unit variance and a length of ln f."""
    x = np.log(frequency)
    return circular(rng, draws, x.size) @ root(np.exp(-0.5 * ((x[:, None] - x) / length) ** 2)).T


def circular(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Circular normal numbers with E|z|^2 = 1."""
    return rng.standard_normal((*shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)


def root(k: np.ndarray) -> np.ndarray:
    """A square root of a covariance that is hardly positive definite."""
    values, vectors = np.linalg.eigh(k)
    return vectors * np.sqrt(np.maximum(values, 0.0))
