"""Resonances that act on a single line of the recordings.

A resonance has three parameters, and a narrow one that lies at a driven line changes the response there and nowhere
else. Where few lines are driven, any error of any one of them can be explained so: by a number of its own for this
line, which is no evidence of a resonance. What tells a resonance is its shape over several lines.
"""

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.compared.simulated import Point
from sim2real.search.fitting import Fit
from sim2real.search.hypotheses import RESONANCES

LINES = 2.0  # effective number of lines on which a resonance must act


def acts_on_one_line(problem: Problem, fit: Fit) -> bool:
    """Whether a resonance among the effects of a fit acts on fewer than LINES lines.

    Args:
        problem: the recordings.
        fit: of a hypothesis.
    """
    names = [name for name in fit.hypothesis.effects if name in RESONANCES]
    if not names or not np.isfinite(fit.cost):
        return False
    at = fit.hypothesis.point(fit.u)
    without = [Point({n: v for n, v in at.effects.items() if n != name}, at.changes, at.dithered) for name in names]
    changes = problem.simulate(without) - (problem.data - fit.residual)
    # Where the rotor touches down without it, a resonance does more than change one line.
    return any(np.isfinite(c).all() and lines_of(problem, c) < LINES for c in changes)


def lines_of(problem: Problem, change: np.ndarray) -> float:
    """Effective number of lines over which the power of a change (K,) of the prediction is spread: the square of its
    sum over the sum of its squares. A line is the same one in all recordings of a rate and a period."""
    power: dict[tuple[float, ...], float] = {}
    for part in problem.parts:
        own = (abs(change[part.place]) ** 2).reshape(*part.measured.shape[:2], -1).sum(axis=(0, 1))
        numbers = part.record.lines[part.used]
        for frequency, number, p in zip(part.record.frequency[part.used], numbers, own, strict=True):
            key = (float(frequency), float(number))
            power[key] = power.get(key, 0.0) + float(p)
    each = np.array(list(power.values()))
    return float(each.sum() ** 2 / np.sum(each**2)) if each.any() else 0.0
