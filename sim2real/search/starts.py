"""Where fits of single effects begin."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from math import isinf

import numpy as np

from maglev_env.loop.card import SMALL_ROTOR, Scales
from maglev_env.loop.effect import EFFECTS
from sim2real.search.hypotheses import Hypothesis, coordinates_of
from sim2real.search.shapes import shapes_of

# Starts of a knee at another place: multiples of the current that is reached, with the coordinate of its sharpness.
ELSEWHERE, SHARPNESS = ((0.7, 0.0), (1.5, 0.0), (3.0, 0.0), (1.5, -1.2), (3.0, -1.2), (6.0, -1.2)), "sharpness"
LEAST_BEYOND = 0.3
# Forms that are another effect altogether while what they stand for is strong: under ripple, iron lags in time.
DITHERS: Mapping[str, tuple[str, ...]] = {"hysteresis": ("hysteresis.ripple",)}
# Where fits begin in forms that no fit of the plain formula leads to, in standard deviations. A current loop with
# integral action overshoots and hardly lags. What hardens far more steeply than a spring behind a gap, another law of
# the magnets makes up for: a plain stop then ends where nothing touches it.
ANOTHER: Mapping[str, tuple[Mapping[str, float], ...]] = {
    **{name: tuple({key: at} for key in keys for at in (0.5, 1.5, 2.5)) for name, keys in DITHERS.items()},
    "amplifier_lag": ({"amplifier_lag.lead": 2.0, "amplifier_lag.feedback": 0.4},),
    "soft_stop": ({"soft_stop.steepness": 1.0},),
    "saturation": ({"saturation.sharpness": 2.0}, {"saturation.sharpness": -1.2}),
}


def starts(name: str, scales: Scales = SMALL_ROTOR) -> list[np.ndarray]:
    """Coordinates at which a fit of one effect may start on a rig of these scales; none if it is only a form there."""
    own = coordinates_of(name, scales)
    if not own:
        return []
    grid = np.meshgrid(*(EFFECTS[name].parameters[c.parameter].on(scales).starts for c in own), indexing="ij")
    points = np.stack([g.ravel() for g in grid], axis=1)
    return [np.array([c.at(float(v)) for c, v in zip(own, row, strict=True)]) for row in points]


def starts_elsewhere(hypothesis: Hypothesis, name: str, reached: float) -> list[tuple[Hypothesis, np.ndarray]]:
    """Starts of one effect alone at the other places where it may sit, as forms with an infinite default, and in the
    forms that make another effect of it (ANOTHER).

    At a knee its plain parameters are at their upper bounds, where they change nothing. A knee that lies far above the
    currents of the recordings changes nothing either, and far below them no rotor levitates. A smooth one bends far
    below its limit, so it begins in that form, too.

    Args:
        hypothesis: What else is assumed.
        name: The effect.
        reached: Current that the recordings reach, A. A single magnet's knee begins that far beyond the current at
            rest, or beyond it by LEAST_BEYOND of it, where the bend about rest shows.
    """
    found = []
    rest = hypothesis.scales.rest
    reached = max(reached, LEAST_BEYOND * rest)
    free = replace(hypothesis.instead(name), shaped=(name,))
    smooth = f"{name}.{SHARPNESS}"
    for shape in shapes_of(name, hypothesis.scales):
        for times, rounder in ELSEWHERE if isinf(shape.parameter.default) else ():
            u = np.zeros(free.size)
            u[: len(free.coordinates)] = [c.at(c.high) for c in free.coordinates]
            knee = rest + times * reached
            u[len(free.coordinates) + free.calibrated.index(shape.name)] = 1 / (knee * shape.parameter.shape)
            if smooth in free.shapes:
                u[len(free.coordinates) + free.calibrated.index(smooth)] = rounder
            found.append((free, u))
    for form, start in product(ANOTHER.get(name, ()), starts(name, hypothesis.scales)):
        if free.shapes.keys() >= form.keys():
            u = np.concatenate([start, np.zeros(len(free.calibrated))])
            u[[len(free.coordinates) + free.calibrated.index(key) for key in form]] = list(form.values())
            found.append((free, u))
    return found
