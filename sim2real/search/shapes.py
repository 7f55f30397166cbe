"""Coordinates of the forms of effects: how a fit moves them, and between which bounds."""

from dataclasses import dataclass, replace
from functools import lru_cache
from math import exp, inf, isinf, log

import numpy as np

from maglev_env.loop.card import SMALL_ROTOR, Parameter, Scales
from maglev_env.loop.effect import EFFECTS

MOST_SHAPE = 4.0  # prior standard deviations
BEYOND = 0.01  # share of the current at rest: a knee nearer to it leaves next to nothing of the actuator's gain


@dataclass(frozen=True)
class Shape:
    """A coordinate of an effect's form, in units of its prior standard deviation (see `Parameter.shape`)."""

    effect: str
    key: str
    parameter: Parameter

    @property
    def name(self) -> str:
        return f"{self.effect}.{self.key}"

    def at(self, value: float) -> float:
        """The coordinate of a value; of one whose logarithm is varied, above zero."""
        p = self.parameter
        middle = p.default if p.centre is None else p.centre
        return log(value / middle) / p.shape if p.scale is None else (value - middle) / p.shape

    def value(self, u: float) -> float:
        p = self.parameter
        if isinf(p.default):
            return p.default if u * p.shape * p.high <= 1 else max(1 / (u * p.shape), p.low)
        middle = p.default if p.centre is None else p.centre
        if p.scale is None:
            return float(np.clip(middle * exp(min(u * p.shape, 700.0)), p.low, p.high))
        return float(np.clip(middle + u * p.shape, p.low, p.high))

    def bounded(self, u: float) -> float:
        """u moved to within the bounds of the parameter, and to within MOST_SHAPE standard deviations."""
        p, middle = self.parameter, self.parameter.default if self.parameter.centre is None else self.parameter.centre
        if isinf(p.default):
            low, high = 0.0, 1 / (p.low * p.shape)
        elif p.scale is None:
            low, high = (log(edge / middle) / p.shape if edge > 0 else -inf for edge in (p.low, p.high))
        else:
            low, high = ((edge - middle) / p.shape for edge in (p.low, p.high))
        most = inf if isinf(p.default) else MOST_SHAPE
        return float(np.clip(u, max(low, -most), min(high, most)))

    def change(self, u: float) -> float:
        """Change of the value per unit of u."""
        step = 1e-4
        values = self.value(u + step), self.value(max(u - step, 0.0) if isinf(self.parameter.default) else u - step)
        return abs(values[0] - values[1]) / (2 * step) if np.isfinite(values).all() else inf


@lru_cache
def shapes_of(name: str, scales: Scales = SMALL_ROTOR) -> tuple[Shape, ...]:
    """Coordinates of an effect's form on a rig of these scales."""
    own = ((key, p) for key, p in EFFECTS[name].shapes.items() if p.is_meant_on(scales))
    return tuple(Shape(name, key, _on(p, scales)) for key, p in own)


def _on(p: Parameter, scales: Scales) -> Parameter:
    """The coordinate on a rig of these scales, beyond the current at rest where it must be."""
    if not (p.beyond_rest and scales.rest):
        return p.on(scales)
    return replace(p.on(scales), low=max(p.low, scales.rest * (1 + BEYOND)), shape=1 / scales.rest)
