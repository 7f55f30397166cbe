"""Does the actuator's gain differ from recording to recording, as of magnets that warm up during a campaign?

One rig is fitted to all recordings. What changed between them is no effect of it, and passes for a nonlinearity where
the recordings also differ in amplitude.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit, inverse
from sim2real.search.following import following
from sim2real.words import percent

GAIN = "actuator_gain"
CLOSES, CLEAR = 0.7, 6.0  # share of the gap that it must close, and standard errors of the largest difference


@dataclass(frozen=True)
class GainBetween:
    """Relative differences of the actuator's gain from that in the first recording, which is fitted.

    Attributes:
        change: By recording, to first order.
        closes: Share of the gap of the recordings that they close.
    """

    change: Mapping[str, float]
    closes: float

    def in_words(self) -> str:
        """A sentence on it."""
        each = ", ".join(f"{name} about {100 * change:+.1g} %" for name, change in self.change.items())
        return (
            f"a gain of the actuator that differs from recording to recording (against the first one: {each}) alone "
            f"closes {percent(self.closes)} of the gap of the fitted recordings: repeat the first recording after the "
            "last one, which tells a change with time, as of temperature, from an effect"
        )


def gain_between(fitted: Problem, fit: Fit) -> GainBetween | None:
    """How the gain differs between recordings, to first order; None where that explains little, or is not told.

    Args:
        fitted: The recordings.
        fit: A fit of them by calibration alone, with its Jacobian.
    """
    h = fit.hypothesis
    if len(fitted.parts) < 2 or fit.jacobian is None or GAIN not in h.calibrated or fit.excess <= 0:
        return None
    sigma, row = h.sigma(GAIN), fit.jacobian[len(h.coordinates) + h.calibrated.index(GAIN)]
    own = np.array([row * (fitted.record == k) for k in range(1, len(fitted.parts))])
    beside = following(fit)
    normal, along = beside.along(own)
    covariance = inverse(normal)
    change = covariance @ along
    saved = beside.promised + float(along @ change)
    misfit = max((fit.cost - saved) / (2 * fit.residual.size), 1.0)
    se = np.sqrt(misfit * np.diag(covariance))
    if saved < CLOSES * fit.excess or not (np.abs(change) > CLEAR * se).any():
        return None
    names = [p.record.name for p in fitted.parts[1:]]
    return GainBetween({n: float(sigma * d) for n, d in zip(names, change, strict=True)}, min(saved / fit.excess, 1.0))
