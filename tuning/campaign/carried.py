"""Responses of the loop at any gains: a fitted rig, and what the recordings differ from it, carried along as draws."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.gains import Gains, controller_response
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import Rig
from tuning.campaign.gain_set import GainSet, Response
from tuning.campaign.rig_fit import IdentifiedRig

DRAWS = 64  # the first is the best estimate
# The relative difference between measured and fitted response is a Gaussian process over the logarithm of the
# frequency. Its standard deviation and length (of ln f) are among these, by their marginal likelihoods.
DEVIATIONS, LENGTHS = (0.003, 0.01, 0.03, 0.1, 0.3), (0.03, 0.1, 0.3, 1.0)
LEAST = 0.02  # probability below which a standard deviation and length are left out
MOST_LINES = 200  # more are averaged in bins of the logarithm of the frequency
CHANCE = 1e-4  # that noise alone moves any line so far from the smooth difference that its measurement stands instead
ELSEWHERE = 0.01  # relative standard deviation by which the plant may change where the controller doubles
ELSEWHERE_LENGTH = 1.0  # of ln f, over which that change is one


@dataclass(frozen=True, eq=False)
class Carried:
    """Draws of a loop's open responses; the first is the best estimate.

    Attributes:
        rate: Control rate, Hz.
        injected: Frequencies (s,) of the sensitivity, Hz.
        forced: Frequencies (r,) of the receptance, Hz.
        plant: (DRAWS, s), from command to reading, m/A.
        plant_forced: (DRAWS, r), the same at the frequencies of the receptance.
        free: (DRAWS, r), from force to reading with the loop open, m/N.
        change: (DRAWS, s + r), relative change of the plant where a controller doubles; the first is zero.
        thetas: (DRAWS, p), parameters of the fitted rig.
        sharp: Frequencies (Hz) at which the plant as measured is no smooth neighbour of the fitted one's.
    """

    rate: float
    injected: np.ndarray
    forced: np.ndarray
    plant: np.ndarray
    plant_forced: np.ndarray
    free: np.ndarray
    change: np.ndarray
    thetas: np.ndarray
    sharp: np.ndarray

    def sensitivity(self, gains: Gains, apart: float = 0.0, draws: int = DRAWS) -> np.ndarray:
        """S (draws, s) under gains; apart: log2 of the factor from recorded gains to these."""
        c = controller_response(gains, self._z(self.injected), 1 / self.rate)
        return 1 / (1 + c * self.plant[:draws] * (1 + apart * self.change[:draws, : self.injected.size]))

    def receptance(self, gains: Gains, apart: float = 0.0, draws: int = DRAWS) -> np.ndarray:
        """Displacement per force (draws, r) of the closed loop, m/N."""
        c = controller_response(gains, self._z(self.forced), 1 / self.rate)
        plant = self.plant_forced[:draws] * (1 + apart * self.change[:draws, self.injected.size :])
        return self.free[:draws] / (1 + c * plant)

    def _z(self, frequency: np.ndarray) -> np.ndarray:
        return np.exp(2j * np.pi * frequency / self.rate)


def carried(identified: IdentifiedRig, sets: Sequence[GainSet], seed: int, sharp: np.ndarray | None = None) -> Carried:
    """Draws from what a fitted rig and the recordings of some gain sets say together.

    Args:
        identified: The rig that was fitted to all recordings.
        sets: Those whose responses count.
        seed: Seed of the draws.
        sharp: Frequencies (Hz) at which other recordings have shown a sharp plant; None: those of these sets alone.
    """
    rng = np.random.default_rng((seed, 271828))
    rig, rate = identified.nominal, identified.nominal.control_rate
    injected, forced = _lines(rig, "current"), _lines(rig, "force")
    plant = _agreed([s.plant for s in sets if s.plant])
    shaken = [s for s in sets if s.receptance]
    wanted = np.unique(np.round(np.concatenate([injected, forced, *(s.receptance.frequency for s in shaken)]), 9))
    every = np.unique(np.concatenate([wanted, np.round(plant.frequency, 9)])) if plant else wanted
    thetas = np.vstack([identified.theta, identified.drawn(DRAWS - 1, rng)])
    models = [_open(identified.rig(theta), every) for theta in thetas]
    p, g = (np.array([m[k] for m in models]) for k in range(2))
    at = _among(every, wanted)
    g = g[:, at]
    per_force = p[:, at] / g  # from command to force: smooth, whatever the rotor and its support do
    more, found = _differences(plant, p, every, wanted, rng, sharp) if plant else (0.0, np.empty(0))
    p = p[:, at] * (1 + more)
    z = np.exp(2j * np.pi * wanted / rate)
    if shaken:
        loops = [controller_response(s.gains, z, 1 / rate) for s in shaken]
        parts = []
        for s, c in zip(shaken, loops, strict=True):
            at = _among(wanted, s.receptance.frequency)
            opening = 1 + c[at] * p[0, at]
            parts.append(
                Response(wanted[at], s.receptance.value * opening, s.receptance.variance * np.abs(opening) ** 2)
            )
        more, seen = _differences(_agreed(parts), g, wanted, wanted, rng, sharp)
        g = g * (1 + more)
        # A draw whose plant is another one opens the measured receptance by another loop.
        mean = np.mean(loops, axis=0)
        g = g * (1 + mean * p) / (1 + mean * p[:1])
        if seen.size:
            at, value = _shaken_plant(shaken, loops, wanted, seen, per_force, rng)
            p[:, at], g[:, at] = value, value / per_force[:, at]
            injected, found = np.union1d(injected, seen), np.union1d(found, seen)
    change = ELSEWHERE * _smooth(wanted, DRAWS, rng)
    change[0] = 0.0
    i, f = _among(wanted, injected), _among(wanted, forced)
    return Carried(rate, injected, forced, p[:, i], p[:, f], g[:, f], change[:, np.concatenate([i, f])], thetas, found)


def _shaken_plant(
    shaken: Sequence[GainSet],
    loops: Sequence[np.ndarray],
    wanted: np.ndarray,
    sharp: np.ndarray,
    per_force: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Places (k,) of sharp force lines among those wanted, and the plant there (draws, k), m/A.

    A force shows a resonance too, and with it how the loop answers there: with H = G / (1 + C P) measured and P = A G,
    P = A H / (1 - C A H), where A leads from command to force.
    """
    parts = []
    for s, c in zip(shaken, loops, strict=True):
        kept = np.isin(np.round(s.receptance.frequency, 9), sharp)
        at = _among(wanted, s.receptance.frequency[kept])
        a, h = per_force[0, at], s.receptance.value[kept]
        left = 1 - c[at] * a * h
        parts.append(Response(wanted[at], a * h / left, s.receptance.variance[kept] * np.abs(a / left**2) ** 2))
    plant = _agreed(parts)
    at = _among(wanted, plant.frequency)
    scatter = _complex(rng, len(per_force), at.size) * np.sqrt(plant.variance)
    scatter[0] = 0.0
    return at, plant.value * per_force[:, at] / per_force[0, at] + scatter


def _among(every: np.ndarray, some: np.ndarray) -> np.ndarray:
    return np.searchsorted(every, np.round(some, 9))


def _lines(rig: Rig, place: str) -> np.ndarray:
    e = rig.protocol.excitations
    return lines_at(e, place) * e[0].fundamental


def _open(rig: Rig, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Plant and free receptance of a rig's linear model; the hold of the force is removed, as of measured ones."""
    loop = loop_response(Experiment(rig, rig.gains, ()), frequency)
    x = frequency / rig.control_rate
    return loop.plant, loop.receptance / loop.sensitivity / (np.sinc(x) * np.exp(-1j * np.pi * x))


def _agreed(parts: Sequence[Response]) -> Response | None:
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


def _binned(ratio: np.ndarray, variance: np.ndarray, frequency: np.ndarray) -> tuple[np.ndarray, ...]:
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


def _differences(
    measured: Response,
    model: np.ndarray,
    every: np.ndarray,
    wanted: np.ndarray,
    rng: np.random.Generator,
    known: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Relative difference (draws, w) of the true response from each draw's model, at frequencies wanted (w,), Hz.

    The model is (draws, n) at frequencies every (n,), those of the measurement among them.

    Draws by Matheron's rule: a path of the prior, corrected by what the measurement says of it. How large and how long
    the differences are is itself drawn by its likelihood; the first draw takes the likeliest. At lines that no such
    path can follow, as at the resonance of a support, the measurement itself stands, with its noise. Their frequencies
    are returned, too; with known ones, those are taken.
    """
    at = _among(every, measured.frequency)
    whole, noisy = measured.value / model[:, at] - 1, measured.variance / np.abs(model[0, at]) ** 2
    ratio, variance, place = _binned(whole, noisy, measured.frequency)
    kinds, weights = _likely(ratio[0], variance, place)
    which = rng.choice(len(kinds), len(ratio), p=weights)
    which[0] = int(weights.argmax())
    everywhere = np.concatenate([place, np.log(wanted)])
    squared, m = (everywhere[:, None] - everywhere) ** 2, place.size
    normal, noise = _complex(rng, len(ratio), everywhere.size), _complex(rng, len(ratio), m) * np.sqrt(variance)
    normal[0], noise[0] = 0.0, 0.0
    found = np.empty((len(ratio), wanted.size), complex)
    for kind in np.unique(which):
        own, (sd, length) = which == kind, kinds[kind]
        k = sd**2 * np.exp(-0.5 * squared / length**2)
        path = normal[own] @ _root(k).T
        left = ratio[own] - path[:, :m] - noise[own]
        found[own] = path[:, m:] + left @ np.linalg.solve(k[:m, :m] + np.diag(variance), k[:m, m:])
    both, line, here = np.intersect1d(np.round(measured.frequency, 9), wanted, return_indices=True)
    missed = np.abs(whole[0, line] - found[0, here]) ** 2 / noisy[line]
    sharp = missed > np.log(max(both.size, 1) / CHANCE) if known is None else np.isin(both, known)
    line, here = line[sharp], here[sharp]
    scatter = _complex(rng, len(whole), line.size) * np.sqrt(noisy[line])
    scatter[0] = 0.0
    found[:, here] = whole[:, line] + scatter
    return found, both[sharp]


def _likely(ratio: np.ndarray, variance: np.ndarray, place: np.ndarray) -> tuple[list[tuple[float, float]], np.ndarray]:
    """(standard deviation, length) of the differences, and their probabilities, for which LEAST is the smallest."""
    squared = (place[:, None] - place) ** 2
    kinds = [(sd, length) for length in LENGTHS for sd in DEVIATIONS]
    values = []
    for sd, length in kinds:
        factor = scipy.linalg.cho_factor(sd**2 * np.exp(-0.5 * squared / length**2) + np.diag(variance), lower=True)
        fit = float(np.real(np.conj(ratio) @ scipy.linalg.cho_solve(factor, ratio)))
        values.append(-fit - 2 * float(np.log(np.diag(factor[0])).sum()))
    weights = np.exp(np.array(values) - max(values))
    weights[weights < LEAST * weights.sum()] = 0.0
    return kinds, weights / weights.sum()


def _smooth(frequency: np.ndarray, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Smooth complex paths (draws, n) of unit variance over ln f."""
    x = np.log(frequency)
    root = _root(np.exp(-0.5 * ((x[:, None] - x) / ELSEWHERE_LENGTH) ** 2))
    return _complex(rng, draws, x.size) @ root.T


def _complex(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Circular normal numbers with E|z|^2 = 1."""
    return rng.standard_normal((*shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)


def _root(k: np.ndarray) -> np.ndarray:
    """A square root of a covariance that is hardly positive definite."""
    values, vectors = np.linalg.eigh(k)
    return vectors * np.sqrt(np.maximum(values, 0.0))
