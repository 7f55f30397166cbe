"""What the means of a suspended mass say: at every level at which it rests, the magnet's pull equals the weight.

The levels (mean displacement, mean current) fix the constant of the force law and, where there are several, its gap; so
they give actuator gain and stiffness on the absolute scale of the weight. They need no motion and no time base, but the
offsets and scales of both channels, within tolerances that the campaign states.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import chi2, norm
from scipy.stats import t as student

from maglev_env.experiment import Experiment
from maglev_env.linear.axis import POSITION, VELOCITY, linear_axis
from maglev_env.loop.magnets.kinds import KINDS, geometric_law
from maglev_env.loop.magnets.law import SingleSidedLaw, force
from maglev_env.recordings.campaign import RecordingSpec
from maglev_env.rig.rig import Rig
from sim2real.recorded.at_rest.levels import Levels, joined, levels_of
from sim2real.recorded.at_rest.weight_law import balanced, departures, fitted
from sim2real.recorded.current_by_voltage import RESISTANCE, told_by_voltage

if TYPE_CHECKING:
    import xarray as xr

AT_REST = "means and weight"  # the name of this evidence in reports
STILL = 0.01  # of the gap: levels that are nearer to each other count as one
DISAGREE = 1e-3  # probability under noise alone from which recordings rest at other currents
APART = 5.0  # standard deviations: three times this, and three times STILL of the gap, levels must span for a stiffness
GROUPS = 10  # of the jackknife


@dataclass(frozen=True)
class Tolerances:
    """What the campaign states of the two channels: standard uncertainties of offset (m, A) and relative scale.

    The drifts are standard deviations of the offsets from recording to recording; nan: not stated.
    """

    displacement_offset: float
    current_offset: float
    displacement_scale: float = 0.0
    current_scale: float = 0.0
    displacement_drift: float = np.nan
    current_drift: float = np.nan


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
        drift: standard deviation of the current's offset from recording to recording, A.
    """

    gain: float
    stiffness: float | None
    covariance: np.ndarray
    levels: int
    drift: float = 0.0

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
    uncertainty of the offsets of both displacement and current, or of the voltage that tells the current."""
    told, per = ("voltage", rig.coil_resistance) if told_by_voltage(rig, spec.channels) else ("current", 1.0)
    shown = [spec.channels.get(name) for name in ("displacement", told)]
    if not can_rest(rig) or any(source is None or source.offset_tolerance is None for source in shown):
        return None
    displacement, driving = shown
    unsure = 0.0 if told == "current" else rig.tolerance.get("coil_resistance", RESISTANCE)
    tolerances = Tolerances(
        displacement.offset_tolerance,
        driving.offset_tolerance / per,
        displacement.scale_tolerance,
        float(np.hypot(driving.scale_tolerance, unsure)),
        np.nan if displacement.offset_drift is None else displacement.offset_drift,
        np.nan if driving.offset_drift is None else driving.offset_drift / per,
    )
    falls = rig.gravity / spec.sample_rate**2
    # Where the mass rests in the mean, neither the inductance nor the motion takes any of the mean voltage.
    current = dataset[told].values / per
    return Rests(levels_of(dataset["displacement"].values, current, rig, falls), tolerances)


def static_of(rig: Rig, rests: Sequence[Rests | None]) -> StaticEstimate | None:
    """The static estimate of recordings together; their tolerances are taken as the largest stated."""
    stated = [r for r in rests if r is not None]
    if not stated:
        return None
    worst = Tolerances(*(np.fmax.reduce([getattr(r.tolerances, f.name) for r in stated]) for f in fields(Tolerances)))
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
    more, less = (balanced(law, lambda y, i: force(law, y, i) + law.weight, weight, start=0.0) for weight in weights)
    gain, stiffness = np.log(more / less) / (2 * h)
    return float(gain), float(stiffness)


def static_estimate(rig: Rig, levels: Levels, tolerances: Tolerances) -> StaticEstimate | None:
    """Fit the force law's constant and gap to levels and weight; None where the mass never rests.

    The scatter of the levels about the law is told by the jackknife over groups of them, so it includes what the law
    cannot fit. Where a drift is stated, or the recordings disagree by more than their scatter, each has an offset of
    its own (a coil that warms, an amplifier that drifts).

    Args:
        rig: nominal rig, whose force law gives the form.
        levels: of all recordings.
        tolerances: of both channels; offsets and scales are common to all recordings.
    """
    if levels.count == 0:
        return None
    law = geometric_law(rig)
    distance = max(APART * float(np.median(levels.displacement_sd)), STILL * rig.gap)
    several = levels.count > 3 and np.ptp(levels.displacement) > 3 * distance
    drift, wider = _drift(law, levels, several, tolerances)
    coefficients = fitted(law, levels, several, drift)
    labels = np.arange(levels.count) % min(levels.count, GROUPS)
    covariance = np.zeros((coefficients.size, coefficients.size))
    if levels.count > coefficients.size + 1:
        groups = labels.max() + 1
        left = np.array([fitted(law, levels.of(labels != g), several, drift) for g in range(groups)])
        covariance += (groups - 1) * np.atleast_2d(np.cov(left.T, ddof=0))
    else:
        noise = [_moved(levels, float(levels.displacement_sd.mean()), 0.0),
                 _moved(levels, 0.0, float(levels.current_sd.mean()))]  # fmt: skip
        covariance += sum(_outer(fitted(law, other, several, drift) - coefficients) for other in noise)
    total = levels.current + law.bias_current
    for dy, di in (
        (tolerances.displacement_offset, 0.0),
        (0.0, tolerances.current_offset),
        (tolerances.displacement_scale * levels.displacement, 0.0),
        (0.0, tolerances.current_scale * total),
    ):
        covariance += _outer(fitted(law, _moved(levels, dy, di), several, drift) - coefficients)
    for number in np.unique(levels.recording) if drift else ():
        own = _moved(levels, 0.0, wider * drift * (levels.recording == number))
        covariance += _outer(fitted(law, own, several, drift) - coefficients)
    covariance += _outer(coefficients * rig.tolerance.get("mass", 0.0))  # both are in proportion to the weight
    stiffness = float(coefficients[1]) if several else None
    return StaticEstimate(float(coefficients[0]), stiffness, covariance, levels.count, drift)


def drift_in_words(found: StaticEstimate) -> str:
    """What is said of recordings that rest at other currents; empty where they agree."""
    if not found.drift:
        return ""
    return (
        f"means and weight: the current at the same place differs from recording to recording, by {found.drift:.2g} A "
        "(a coil that warms, an amplifier or a probe that drifts); an offset of each is allowed for"
    )


def _drift(law: SingleSidedLaw, levels: Levels, several: bool, tolerances: Tolerances) -> tuple[float, float]:
    """Standard deviation (A) of the current's offset from recording to recording, 0 where nothing shows any; and how
    many times that of a normal distribution its 95 % interval reaches.

    Offsets of the size of the stated tolerance are taken to have it. Larger ones contradict it: then their size is
    known from as many recordings as there are, and the interval is Student's.
    """
    gain, stiffness = balanced(law, lambda y, i: force(law, y, i) + law.weight, law.weight, 0.0)
    slope = abs(stiffness / gain)  # A/m
    stated = np.array([tolerances.displacement_drift * slope, tolerances.current_drift])
    if np.isfinite(stated).any():
        return float(np.sqrt(np.nansum(stated**2))), 1.0
    numbers = np.unique(levels.recording)
    if numbers.size == 1:
        return 0.0, 1.0
    known = tolerances.current_offset**2 + (tolerances.displacement_offset * slope) ** 2
    square, wider = known, 1.0
    for _ in range(2):  # with an offset each, so that recordings at different levels do not tilt the curve instead
        off = departures(law, levels, several, float(np.sqrt(square)))
        own = [off[levels.recording == number] for number in numbers]
        scatter = np.sqrt(sum(part.var() * part.size for part in own) / max(off.size - numbers.size, 1))
        noise = np.array([scatter / np.sqrt(part.size) for part in own])
        means = np.array([part.mean() for part in own])
        means -= np.average(means, weights=noise**-2.0 if noise.all() else None)
        if not noise.all() or np.sum((means / noise) ** 2) < chi2.isf(DISAGREE, numbers.size - 1):
            return 0.0, 1.0
        seen = float(np.sum(means**2 - noise**2)) / (numbers.size - 1)
        square = max(seen, known)
        wider = float(student.isf(0.025, numbers.size - 1) / norm.isf(0.025)) if seen > known else 1.0
    return float(np.sqrt(square)), wider


def _moved(levels: Levels, dy: np.ndarray | float, di: np.ndarray | float) -> Levels:
    return replace(levels, displacement=levels.displacement + dy, current=levels.current + di)


def _outer(change: np.ndarray) -> np.ndarray:
    return np.outer(change, change)
