"""Actuator gain and the magnet's own stiffness and damping of a rotor of known mass, from the coil current.

No force transducer is needed: the known mass sets the scale of the force.
"""

from dataclasses import dataclass, replace

import numpy as np

from estimation.lines.periods import LineStatistics
from estimation.modal import global_fit


@dataclass(frozen=True)
class ActuatorEstimate:
    """Result of `actuator_estimate`; every quantity has a standard error of the same name with the suffix `_se`.

    Attributes:
        gain: Force per current, N/A.
        stiffness: Stiffness of the uncontrolled rotor, N/m (negative: the magnet pulls away from the centre).
        damping: Damping of the uncontrolled rotor, N s/m.
        cost_ratio: As in `ModalEstimate`.
        discrepancy: As in `ModalEstimate`.
    """

    gain: float
    stiffness: float
    damping: float
    gain_se: float
    stiffness_se: float
    damping_se: float
    cost_ratio: float
    discrepancy: float

    def with_errors(self, gain: float, stiffness: float, damping: float) -> "ActuatorEstimate":
        """The same with further, independent standard errors."""
        return replace(
            self,
            gain_se=float(np.hypot(self.gain_se, gain)),
            stiffness_se=float(np.hypot(self.stiffness_se, stiffness)),
            damping_se=float(np.hypot(self.damping_se, damping)),
        )


def actuator_estimate(statistics: LineStatistics, mass: float) -> ActuatorEstimate:
    """Fit gain I = (k - m w^2 + j w c) Y over all lines of one record by errors-in-variables maximum likelihood.

    The amplitudes are responses to an injected signal, so noise that runs around the control loop does not bias them.

    Args:
        statistics: Channels "current" and "displacement" at lines that an injection excites.
        mass: Moving mass, kg; it sets the scale of the force.

    Returns:
        The estimate. A current that flows in the opposite direction gives a negative gain.

    Raises:
        ValueError: Fewer than four lines, or a mass that is not positive.
    """
    if not mass > 0:
        raise ValueError(f"mass = {mass} kg must be positive; the known mass sets the scale of the actuator gain")
    fit = global_fit(as_force(statistics, "current", 1.0))
    k, c, m = fit.values
    gain = mass / m
    slopes = np.array([[0, 0, -gain / m], [gain, 0, -k * gain / m], [0, gain, -c * gain / m]])
    se = np.sqrt(np.diag(slopes @ fit.covariance @ slopes.T))
    return ActuatorEstimate(gain, k * gain, c * gain, *se, cost_ratio=fit.cost_ratio, discrepancy=fit.discrepancy)


def as_force(statistics: LineStatistics, channel: str, gain: float) -> LineStatistics:
    """Statistics in which one channel, multiplied by gain, replaces the force; a recorded force is dropped."""
    keep = [i for i, name in enumerate(statistics.channels) if name != "force" or name == channel]
    names = [statistics.channels[i] for i in keep]
    factor = np.where(np.array(names) == channel, gain, 1.0)
    return replace(
        statistics,
        channels=tuple("force" if name == channel else name for name in names),
        mean=statistics.mean[keep] * factor[:, None],
        covariance=statistics.covariance[np.ix_(keep, keep)] * (factor[:, None] * factor)[:, :, None],
    )
