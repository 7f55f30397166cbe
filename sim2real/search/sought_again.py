"""What a form adds, such as a further mode, is sought again at the end of a fit.

Its place was chosen while the other effects had their plain form, and it went to where that left most: of a friction
beside a support with two modes, to what the friction left. Once it sits there nothing moves it along the frequencies.
"""

from collections.abc import Sequence

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit, above_noise
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.shaping import STEPS, hoped, places_of_added

FOLLOWED = 2  # places that are followed to their minimum
FURTHER = ("further_ratio", "further_frequency", "further_damping")
# Size of the first mode of an effect, and whether that of the further one is a multiple of it.
SIZES = {"support_resonance": ("mass_ratio", False), "sensor_resonance": ("coupling", True)}


def sought_again(problem: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """The fits, of which the best one has its further modes where they explain most.

    Args:
        problem: The problem.
        fits: Fits of hypotheses, in all forms.
    """
    best = min(fits, key=lambda f: f.cost, default=None)
    if best is None or not np.isfinite(best.cost) or not above_noise(best.cost, problem.data.size):
        return list(fits)
    without = [u for name in SIZES for u in _without_further(best, name)]
    h = best.hypothesis
    bare = begin([h] * len(without), without, problem.data, problem.simulate)
    standing = [f for f in bare if np.isfinite(f.cost)]
    differentiate(standing, problem.data, problem.simulate, True)
    places = [u for f in standing for u in places_of_added(problem, f, h)]
    begun = begin([h] * len(places), places, problem.data, problem.simulate)
    begun = [f for f in begun if np.isfinite(f.cost)]
    differentiate(begun, problem.data, problem.simulate, True)
    moved = sorted(begun, key=hoped)[:FOLLOWED]
    iterate(moved, problem.data, problem.simulate, STEPS, [best.cost] * len(moved))
    new = min(moved, key=lambda f: f.cost + f.occam, default=best)
    better = new if new.cost + new.occam < best.cost + best.occam else best
    return [better if f is best else f for f in fits]


def _without_further(fit: Fit, name: str) -> list[np.ndarray]:
    """Coordinates of a fit without the further mode of an effect, and with that one in place of the first one."""
    h, first = fit.hypothesis, len(fit.hypothesis.coordinates)
    shapes = {key: shape for key in FURTHER if (shape := h.shapes.get(f"{name}.{key}"))}
    if not shapes:
        return []
    at = {key: first + h.calibrated.index(shape.name) for key, shape in shapes.items()}
    ratio, times, damping = (shapes[key].value(float(fit.u[at[key]])) for key in FURTHER)
    if not ratio:
        return []
    gone = fit.u.copy()
    gone[[*at.values()]] = 0.0
    values, (size, multiple) = h.point(fit.u).effects[name], SIZES[name]
    first_one = {
        "frequency": times * values["frequency"],
        "damping_ratio": damping,
        size: ratio * values[size] if multiple else ratio,
    }
    swapped = gone.copy()
    for i, c in enumerate(h.coordinates):
        if c.effect == name and c.parameter in first_one:
            swapped[i] = c.at(first_one[c.parameter])
    return [gone, h.bounded(swapped)]
