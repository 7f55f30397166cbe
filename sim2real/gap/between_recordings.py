"""Does a gain or a delay differ from recording to recording, as of magnets that warm up during a campaign?

One rig is fitted to all recordings. What changed between them is no effect of it, and passes for a nonlinearity where
the recordings also differ in amplitude.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit, inverse
from sim2real.search.following import following
from sim2real.words import percent, quantity

GAIN, DELAY = "actuator_gain", "delay"
CLOSES, CLEAR = 0.7, 6.0  # share of the gap that it must close, and standard errors of the largest difference
STEP = 1e-4  # of a coordinate, for what it changes


@dataclass(frozen=True)
class Between:
    """Differences of a gain or a delay from that in the first recording, which is fitted.

    Attributes:
        effect: "actuator_gain" or "delay".
        change: By recording, to first order: relative, or s.
        closes: Share of the gap of the recordings that they close.
    """

    effect: str
    change: Mapping[str, float]
    closes: float

    def in_words(self) -> str:
        """A sentence on it."""
        of_gain = self.effect == GAIN
        sizes = (
            f"{100 * c:+.1g} %" if of_gain else f"{'+' * (c > 0)}{quantity(c, None, 's')}" for c in self.change.values()
        )
        each = ", ".join(f"{name} about {size}" for name, size in zip(self.change, sizes, strict=True))
        what = "a gain of the actuator" if of_gain else "a delay of the command"
        why = "a change with time, as of temperature, from an effect" if of_gain else "whether it is another each time"
        return (
            f"{what} that differs from recording to recording (against the first one: {each}) alone closes "
            f"{percent(self.closes)} of the gap of the fitted recordings: repeat the first recording after the last "
            f"one, which tells {why}"
        )


def between_recordings(fitted: Problem, calibration: Fit, delayed: Fit | None = None) -> Between | None:
    """How a gain, or else a delay, differs between recordings, to first order; None where that explains little, or is
    not told.

    Args:
        fitted: The recordings.
        calibration: A fit of them by calibration alone, with its Jacobian.
        delayed: A fit with a delay beside it; None: there is none.
    """
    if len(fitted.parts) < 2 or calibration.excess <= 0:
        return None
    found, h = [], calibration.hypothesis
    if GAIN in h.calibrated:
        found.append(_between(fitted, calibration, len(h.coordinates) + h.calibrated.index(GAIN), GAIN, h.sigma(GAIN),
                              calibration.excess))  # fmt: skip
    if delayed is not None and np.isfinite(delayed.cost):
        (time,), (u, *_) = delayed.hypothesis.coordinates, delayed.u
        each = (time.value(u + STEP) - time.value(u - STEP)) / (2 * STEP)
        found.append(_between(fitted, delayed, 0, DELAY, each, calibration.excess))
    return max(filter(None, found), key=lambda one: one.closes, default=None)


def _between(fitted: Problem, fit: Fit, at: int, effect: str, unit: float, gap: float) -> Between | None:
    """That of the coordinate `at` of a fit, of which one is so many units; gap: what calibration alone leaves."""
    if fit.jacobian is None:
        return None
    row = fit.jacobian[at]
    own = np.array([row * (fitted.record == k) for k in range(1, len(fitted.parts))])
    beside = following(fit)
    normal, along = beside.along(own)
    covariance = inverse(normal)
    change = covariance @ along
    saved = gap - fit.excess + beside.promised + float(along @ change)
    misfit = max((gap - saved + fit.cost - fit.excess) / (2 * fit.residual.size), 1.0)
    se = np.sqrt(misfit * np.diag(covariance))
    if saved < CLOSES * gap or not (np.abs(change) > CLEAR * se).any():
        return None
    names = [p.record.name for p in fitted.parts[1:]]
    return Between(effect, {n: float(unit * d) for n, d in zip(names, change, strict=True)}, min(saved / gap, 1.0))
