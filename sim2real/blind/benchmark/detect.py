"""How much an effect shows in a campaign's recordings: differences of mean simulations against the noise.

A mean is a simulation without noise; of an effect that acts at random, or otherwise where noise moves the loop, it is
the mean over draws, which are the same with the effect and without. Noise spectra come from noisy simulations of the
same rig without the effect, smoothed over neighbouring frequencies, with the covariance of the channels. A difference
is calibrated away as far as the tolerances allow. What remains is tested with FREEDOM degrees of freedom, the
calibration itself with one for each parameter; at the threshold, the more sensitive of these 1 % chi-square tests has a
power of one half.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import inf, log, sqrt

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from sim2real.blind.benchmark import at
from sim2real.blind.benchmark.kinds import KINDS, Kind
from sim2real.blind.benchmark.simulate import FEW_STEPS, LoopFailed, Recording, Truth, simulate, smoothed

FREEDOM = 500
LEVEL, POWER = 0.01, 0.5
STEP = 0.2  # of a tolerance, for derivatives
NOMINAL = {  # values of effects that move nothing but a parameter of the rig
    at.MASS: "mass",
    at.GAIN: "actuator_gain",
    at.STIFFENING: "negative_stiffness",
    at.SCALE: "probe_gain",
    at.SUPPORT: "support_stiffness",
}
FAR, RECALIBRATIONS = 2.0, 4  # standard deviations beyond which a linear calibration will not do, and its repetitions
RANDOM = frozenset(kind.value for kind in KINDS.values() if kind.random)
ROUGH = frozenset(kind.value for kind in KINDS.values() if kind.rough)
_PAIRS = 2  # of noisy simulations
_DROPS = 2  # draws of lost commands in an estimate of their mean
_NEIGHBOURS = 31  # frequencies that share a covariance


def critical(freedom: int) -> float:
    """Non-centrality at which a chi-square test of LEVEL with these degrees of freedom has the power POWER."""
    limit = chi2.isf(LEVEL, freedom)
    return float(brentq(lambda x: ncx2.sf(limit, freedom, x) - POWER, 1e-3, 20 * limit))


class Detector:
    """Compares rigs with a true one by what recordings of a campaign show.

    Args:
        truth: The rig with its deviations, without effects.
        recordings: Its experiments; those of another role are ignored.
        with_current: Whether the current is recorded.
        seed: Of the noise from which its spectra are estimated.
        roles: Of the recordings that count.
    """

    def __init__(
        self,
        truth: Truth,
        recordings: Sequence[Recording],
        with_current: bool,
        seed: int,
        roles: Sequence[str] = ("fit",),
    ):
        self.truth = truth
        self.recordings = [r for r in recordings if r.role in roles]
        self._every, self._with_current = list(recordings), with_current
        self.names = ("displacement", "current") if with_current else ("displacement",)
        self.seed = seed
        self._smoothed: dict[tuple[int, int], np.ndarray] = {}  # as `_base`, by recording and draw of the noise

    def of_all_recordings(self) -> "Detector":
        """The same of all recordings of the campaign, those to fit and the holdout."""
        return Detector(self.truth, self._every, self._with_current, self.seed, ("fit", "holdout"))

    @cached_property
    def _base(self) -> list[np.ndarray]:
        return [self._spectrum(self.truth, r) for r in self.recordings]

    @cached_property
    def _whitening(self) -> list[np.ndarray]:
        """For each recording (frequencies, channels, channels): makes noise of unit real and imaginary variance."""
        found = []
        for number, r in enumerate(self.recordings):
            seeds = np.random.default_rng([self.seed, number]).integers(2**62, size=(_PAIRS, 2))
            total = 0.0
            for one, other in seeds:
                n = self._spectrum(self.truth, r, int(one)) - self._spectrum(self.truth, r, int(other))
                total = total + n[:, :, None] * n[:, None, :].conj() / (2 * _PAIRS)
            smooth = _smoothed(total.real) + 1j * _smoothed(total.imag)
            found.append(sqrt(2) * np.linalg.inv(np.linalg.cholesky(smooth)))
        return found

    @cached_property
    def calibration(self) -> np.ndarray:
        """Whitened change for one standard deviation of each uncertain parameter (parameters, values)."""
        rows = []
        for name, tolerance in self.truth.rig.tolerance.items():
            moved = {**self.truth.deviations, name: self.truth.deviations.get(name, 0.0) + STEP * tolerance}
            rows.append(self.difference(replace(self.truth, deviations=moved)) / STEP)
        return np.array(rows)

    def _spectrum(self, truth: Truth, r: Recording, seed: int | None = None, drops: int = 0) -> np.ndarray:
        return self._of(simulate(truth, r, seed, drops, FEW_STEPS))

    def _of(self, found: Mapping[str, np.ndarray]) -> np.ndarray:
        # Means depend on zero errors of channels and on static loads, of which no campaign states anything.
        return np.fft.rfft(np.hstack([found[name] for name in self.names]), axis=0)[1:]

    def _base_at(self, number: int, draw: int) -> np.ndarray:
        if (number, draw) not in self._smoothed:
            found = smoothed(self.truth, self.recordings[number], draw, 0, FEW_STEPS)
            self._smoothed[number, draw] = self._of(found)
        return self._smoothed[number, draw]

    def difference(self, other: Truth, drops: int = 0, draw: int | None = None) -> np.ndarray:
        """Whitened difference of another rig from the true one (values,).

        Args:
            other: The other rig.
            drops: Seed of which commands are lost.
            draw: Of the noise that moves both; None: without noise.

        Raises:
            LoopFailed: It touches its stops.
        """
        parts = []
        for n, (r, whitening) in enumerate(zip(self.recordings, self._whitening, strict=True)):
            if draw is None:
                moved = self._spectrum(other, r, None, drops) - self._base[n]
            else:
                moved = self._of(smoothed(other, r, draw, drops, FEW_STEPS)) - self._base_at(n, draw)
            part = np.einsum("fij,fj->fi", whitening, moved)
            parts += [part.real.ravel(), part.imag.ravel()]
        return np.concatenate(parts)

    def with_effects(self, values: Mapping[int, float], theta: Sequence[float] = (), most: int = 2) -> np.ndarray:
        """Differences of the true rig with effects, its uncertain parameters moved by theta standard deviations.

        Args:
            values: Values of the effects.
            theta: How far the parameters are moved.
            most: Number of estimates that are wanted; 1 is enough for a direction.

        Returns:
            (1, values), or where chance has a part two estimates of the mean difference (2, values). Their errors are
            independent, so that the product of the one and the other is right in the mean.

        Raises:
            LoopFailed: The rig touches its stops.
        """
        off = dict(self.truth.deviations)
        for (name, tolerance), moved in zip(self.truth.rig.tolerance.items(), theta, strict=False):
            off[name] = off.get(name, 0.0) + tolerance * moved
        other = replace(self.truth, deviations=off, effects=values)
        random, rough = not RANDOM.isdisjoint(values), not ROUGH.isdisjoint(values)
        draws = range(most if random or rough else 1)
        return np.array([self._mean(other, draw, random, rough) for draw in draws])

    def _mean(self, other: Truth, draw: int, random: bool, rough: bool) -> np.ndarray:
        drops = range(_DROPS * draw, _DROPS * (draw + 1)) if random else [0]
        return np.mean([self.difference(other, d, draw if rough else None) for d in drops], axis=0)

    def calibrated(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What calibration leaves of whitened differences (..., values), and the parameters it moves.

        These (..., parameters) are in standard deviations.
        """
        rows = self.calibration
        theta = np.linalg.solve(rows @ rows.T + np.eye(len(rows)), rows @ d.T).T
        return d - theta @ rows, theta

    def strength(self, values: Mapping[int, float]) -> float:
        """How strongly effects with these values show: 1 at the threshold, growing with the square of a small effect.

        Raises:
            LoopFailed: The rig touches its stops.
        """
        found = [self.recalibrated(d) for d in self.with_effects(values)]
        (one, theta), (other, theta2) = found[0], found[-1]
        return max(one @ other / critical(FREEDOM), theta @ theta2 / critical(len(theta)), 0.0)

    def recalibrated(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `calibrated`, with the loop simulated at the moved parameters where they move far.

        Raises:
            LoopFailed: It touches its stops there.
        """
        rest, theta = self.calibrated(d)
        rows = self.calibration
        if theta @ theta <= FAR**2:
            return rest, theta
        for _ in range(RECALIBRATIONS):
            rest = d - self.with_effects({}, theta)[0]
            theta = theta + np.linalg.solve(rows @ rows.T + np.eye(len(rows)), rows @ rest - theta)
        return d - self.with_effects({}, theta)[0], theta


def _smoothed(x: np.ndarray) -> np.ndarray:
    """Running mean along the first axis (frequencies)."""
    return uniform_filter1d(x, _NEIGHBOURS, axis=0, mode="nearest")


def threshold(detector: Detector, kind: Kind, sign: float, others: Mapping[int, float]) -> tuple[float, float]:
    """(size at the threshold, largest size at which the loop still stands) of a kind, both positive."""

    def strength(size: float) -> float:
        return detector.strength(kind.values(detector.truth.rig, sign * size, others))

    size, most, above = kind.most, 0.0, None
    for _ in range(14):
        try:
            found = strength(size)
        except LoopFailed:
            size /= 2
            continue
        most = most or size
        if found < 1:
            if above is None:
                return (size / sqrt(found) if found > 0 else inf), most
            high, above_found = above
            slope = log(above_found / max(found, 1e-9)) / log(high / size)
            return high * above_found ** (-1 / slope), most
        above, size = (size, found), size / (2.0 if found < 30 else min(sqrt(found) / 2, 10.0))
    raise LoopFailed("no size at which the loop stands")
