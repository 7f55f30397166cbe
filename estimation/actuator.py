"""What a magnet does to a rotor of known mass, from the current through it: no force transducer needed."""

from dataclasses import dataclass, replace

import numpy as np

from estimation.modal import global_fit
from estimation.periods import LineStatistics


@dataclass(frozen=True)
class ActuatorEstimate:
    """gain N/A, and stiffness N/m (negative: the magnet's own) and damping N s/m of the uncontrolled rotor, each with
    *_se; cost_ratio and discrepancy as in `ModalEstimate`."""

    gain: float
    stiffness: float
    damping: float
    gain_se: float
    stiffness_se: float
    damping_se: float
    cost_ratio: float
    discrepancy: float


def actuator_estimate(statistics: LineStatistics, mass: float) -> ActuatorEstimate:
    """Fit gain I = (k - m w^2 + j w c) Y over all lines of one record by errors-in-variables maximum likelihood.

    statistics: channels "current" and "displacement" at lines that an injection excites; being responses to it, noise
    that runs around the loop does not bias them. mass kg, which sets the scale. A current that flows the other way has
    a negative gain. ValueError for fewer than four lines, or a mass that is not positive.
    """
    if not mass > 0:
        raise ValueError(f"mass = {mass} kg must be positive; the known mass sets the scale of the actuator gain")
    fit = global_fit(as_force(statistics, "current", 1.0))
    k, c, m = fit.values
    gain = mass / m
    slopes = np.array([[0, 0, -gain / m], [gain, 0, -k * gain / m], [0, gain, -c * gain / m]])
    se = np.sqrt(np.diag(slopes @ fit.covariance @ slopes.T))
    return ActuatorEstimate(gain, k * gain, c * gain, *se, fit.cost_ratio, fit.discrepancy)


def as_force(statistics: LineStatistics, channel: str, gain: float) -> LineStatistics:
    """The statistics with one channel, times gain, as the force, and any recorded force left out."""
    keep = [i for i, name in enumerate(statistics.channels) if name != "force" or name == channel]
    names = [statistics.channels[i] for i in keep]
    factor = np.where(np.array(names) == channel, gain, 1.0)
    return replace(
        statistics,
        channels=tuple("force" if name == channel else name for name in names),
        mean=statistics.mean[keep] * factor[:, None],
        covariance=statistics.covariance[np.ix_(keep, keep)] * (factor[:, None] * factor)[:, :, None],
    )
