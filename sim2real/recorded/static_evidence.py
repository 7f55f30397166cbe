"""What the means of a suspended mass say: at every level at which it rests, the magnet's pull equals the weight.

The levels (mean displacement, mean current) fix the constant of the force law and, where there are several, its gap; so
they give actuator gain and stiffness on the absolute scale of the weight. They need no motion and no time base, but the
offsets and scales of both channels, within tolerances that the campaign states.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from maglev_env.experiment import Experiment
from maglev_env.linear.axis import POSITION, VELOCITY, linear_axis
from maglev_env.loop.magnets.kinds import KINDS, geometric_law
from maglev_env.loop.magnets.law import SingleSidedLaw, force
from maglev_env.recordings.campaign import RecordingSpec
from maglev_env.rig.rig import Rig

if TYPE_CHECKING:
    import xarray as xr

AT_REST = "means and weight"  # how this evidence is called
BLOCKS, LEAST, PARTS = 40, 25, 5  # blocks of a record, least samples of a block, and parts whose means must agree
STILL = 0.01  # of the gap: largest change of the mean within a block
APART = 5.0  # standard deviations: three times this, and three times STILL of the gap, levels must span for a stiffness
GROUPS = 10  # of the jackknife


@dataclass(frozen=True)
class Levels:
    """Where a mass rested.

    Args:
        displacement: (n,), m from the rig's centre.
        current: (n,), A from the rig's bias.
        displacement_sd, current_sd: (n,), standard deviations of these means.
    """

    displacement: np.ndarray
    current: np.ndarray
    displacement_sd: np.ndarray
    current_sd: np.ndarray

    @property
    def count(self) -> int:
        return self.displacement.size

    def of(self, chosen: np.ndarray) -> "Levels":
        """Those of a mask (n,)."""
        return Levels(*(getattr(self, f.name)[chosen] for f in fields(self)))


@dataclass(frozen=True)
class Tolerances:
    """What the campaign states of the two channels: standard uncertainties of offset (m, A) and relative scale."""

    displacement_offset: float
    current_offset: float
    displacement_scale: float = 0.0
    current_scale: float = 0.0


@dataclass(frozen=True)
class Rests:
    """The levels of one recording, and what is stated of their channels."""

    levels: Levels
    tolerances: Tolerances


@dataclass(frozen=True)
class StaticEstimate:
    """Actuator gain and stiffness at the rig's centre from levels and weight.

    Args:
        gain: N/A.
        stiffness: N/m, negative; None where all levels are about the same.
        covariance: (2, 2) of both, or (1, 1).
        levels: number of levels.
    """

    gain: float
    stiffness: float | None
    covariance: np.ndarray
    levels: int

    @property
    def values(self) -> np.ndarray:
        """Gain and, where it is told, stiffness."""
        return np.array([self.gain] if self.stiffness is None else [self.gain, self.stiffness])

    def whitened(self, coefficients: np.ndarray) -> np.ndarray:
        """Coefficients (..., 2) of gain and stiffness in standard deviations, (..., 1 or 2)."""
        own = coefficients[..., : len(self.values)]
        return np.linalg.solve(np.linalg.cholesky(self.covariance), own[..., None])[..., 0]


def can_rest(rig: Rig) -> bool:
    """Whether the rig's magnet carries a weight, so that its means say something."""
    return rig.controlled and rig.axes == 1 and not KINDS[rig.magnet].pair and rig.support_stiffness == 0


def rests_of(rig: Rig, spec: RecordingSpec, dataset: "xr.Dataset") -> Rests | None:
    """What a recording's means say; None unless the magnet carries the weight, and the campaign states the standard
    uncertainty of the offsets of both displacement and current."""
    shown = [spec.channels.get(name) for name in ("displacement", "current")]
    if not can_rest(rig) or any(source is None or source.offset_tolerance is None for source in shown):
        return None
    displacement, current = shown
    tolerances = Tolerances(
        displacement.offset_tolerance,
        current.offset_tolerance,
        displacement.scale_tolerance,
        current.scale_tolerance,
    )
    return Rests(levels_of(dataset["displacement"].values, dataset["current"].values, rig.gap), tolerances)


def static_of(rig: Rig, rests: Sequence[Rests | None]) -> StaticEstimate | None:
    """The static estimate of recordings together; their tolerances are taken as the largest stated."""
    stated = [r for r in rests if r is not None]
    if not stated:
        return None
    worst = Tolerances(*(max(getattr(r.tolerances, f.name) for r in stated) for f in fields(Tolerances)))
    return static_estimate(rig, joined([r.levels for r in stated]), worst)


def coefficients_at(e: Experiment) -> np.ndarray:
    """Actuator gain (N/A) and stiffness of the magnets (N/m) of an experiment's linearised rig, per nominal mass.

    Both are compared with what the weight says, which is in proportion to the mass.
    """
    axis = linear_axis(e)
    pushed = axis.rates[VELOCITY] * e.rig.mass
    return np.array([float(pushed @ axis.pulling / (axis.pulling @ axis.pulling)), -float(pushed[POSITION])])


def of_weight(rig: Rig) -> tuple[float, float]:
    """How actuator gain and stiffness at the centre grow with the weight that is carried: d ln / d ln weight."""
    law, h = geometric_law(rig), 1e-4
    weights = law.weight * (1 + h), law.weight * (1 - h)
    more, less = (_balanced(law, lambda y, i: force(law, y, i) + law.weight, weight, start=0.0) for weight in weights)
    gain, stiffness = np.log(more / less) / (2 * h)
    return float(gain), float(stiffness)


def levels_of(displacement: np.ndarray, current: np.ndarray, gap: float) -> Levels:
    """The blocks of a record in which the mass rests: the means of their parts agree.

    Args:
        displacement, current: (samples,), m and A.
        gap: m.
    """
    size = max(displacement.size // BLOCKS, LEAST)
    found = []
    for begin in range(0, displacement.size - size + 1, size):
        part = slice(begin, begin + size)
        means = np.array([[p.mean() for p in np.array_split(s[part], PARTS)] for s in (displacement, current)])
        if np.ptp(means[0]) < STILL * gap:
            found.append((*means.mean(axis=1), *(means.std(axis=1, ddof=1) / np.sqrt(PARTS))))
    return Levels(*np.array(found).reshape(-1, 4).T)


def joined(levels: Sequence[Levels]) -> Levels:
    """The levels of several recordings together."""
    return Levels(*(np.concatenate([getattr(own, f.name) for own in levels]) for f in fields(Levels)))


def static_estimate(rig: Rig, levels: Levels, tolerances: Tolerances) -> StaticEstimate | None:
    """Fit the force law's constant and gap to levels and weight; None where the mass never rests.

    The scatter of the levels about the law is told by the jackknife over groups of them, so it includes what the law
    cannot fit.

    Args:
        rig: nominal rig, whose force law gives the form.
        levels: of all recordings.
        tolerances: of both channels, common to all recordings.
    """
    if levels.count == 0:
        return None
    law = geometric_law(rig)
    distance = max(APART * float(np.median(levels.displacement_sd)), STILL * rig.gap)
    several = levels.count > 3 and np.ptp(levels.displacement) > 3 * distance
    coefficients = _fitted(law, levels, several)
    labels = np.arange(levels.count) % min(levels.count, GROUPS)
    covariance = np.zeros((coefficients.size, coefficients.size))
    if levels.count > coefficients.size + 1:
        groups = labels.max() + 1
        left = np.array([_fitted(law, levels.of(labels != g), several) for g in range(groups)])
        covariance += (groups - 1) * np.atleast_2d(np.cov(left.T, ddof=0))
    else:
        noise = [_moved(levels, float(levels.displacement_sd.mean()), 0.0),
                 _moved(levels, 0.0, float(levels.current_sd.mean()))]  # fmt: skip
        covariance += sum(_outer(_fitted(law, other, several) - coefficients) for other in noise)
    total = levels.current + law.bias_current
    for dy, di in (
        (tolerances.displacement_offset, 0.0),
        (0.0, tolerances.current_offset),
        (tolerances.displacement_scale * levels.displacement, 0.0),
        (0.0, tolerances.current_scale * total),
    ):
        covariance += _outer(_fitted(law, _moved(levels, dy, di), several) - coefficients)
    covariance += _outer(coefficients * rig.tolerance.get("mass", 0.0))  # both are in proportion to the weight
    return StaticEstimate(float(coefficients[0]), float(coefficients[1]) if several else None, covariance, levels.count)


def _fitted(law: SingleSidedLaw, levels: Levels, several: bool) -> np.ndarray:
    """Actuator gain (N/A) and, with several levels, stiffness (N/m) at the centre."""
    y, i = levels.displacement, levels.current

    def pull(p: np.ndarray, at: np.ndarray | float, current: np.ndarray | float) -> np.ndarray | float:
        own = law
        if several:  # the gap of an exponential decay only scales the pull
            own = replace(law, decay=law.decay * (1 + p[1])) if law.decay else replace(law, gap=law.gap * (1 + p[1]))
        return np.exp(p[0]) * (force(own, at, current) + law.weight)

    start = [np.log(law.weight / float(np.mean(pull(np.zeros(2), y, i)))), 0.0][: 1 + several]
    p = least_squares(lambda p: pull(p, y, i) / law.weight - 1, start, x_scale=0.1).x
    found = _balanced(law, lambda at, current: pull(p, at, current), law.weight, float(i.mean()))
    return found[: 1 + several]


def _balanced(
    law: SingleSidedLaw, pull: Callable[[float, float], np.ndarray | float], weight: float, start: float
) -> np.ndarray:
    """Actuator gain (N/A) and stiffness (N/m) at the centre, (2,), with the current that carries a weight there.

    Args:
        law: gives the sizes of the differences.
        pull: N at a displacement (m) and control current (A); it grows with the current.
        weight: N.
        start: current from which Newton's steps go, A.
    """
    di, dy, current = 1e-5 * max(abs(law.bias_current), 1e-9), 1e-5 * law.gap, start

    def gain(at: float) -> float:
        return float((pull(0.0, at + di) - pull(0.0, at - di)) / (2 * di))

    for _ in range(50):
        current -= (float(pull(0.0, current)) - weight) / gain(current)
    return np.array([gain(current), -float(pull(dy, current) - pull(-dy, current)) / (2 * dy)])


def _moved(levels: Levels, dy: np.ndarray | float, di: np.ndarray | float) -> Levels:
    return replace(levels, displacement=levels.displacement + dy, current=levels.current + di)


def _outer(change: np.ndarray) -> np.ndarray:
    return np.outer(change, change)
