"""Resonances that act on a single line of the recordings.

A resonance has three parameters, and a narrow one that lies at a driven line changes the response there and nowhere
else. Where few lines are driven, any error of any one of them can be explained so: by a number of its own for this
line, which is no evidence of a resonance. What tells a resonance is its shape over several lines: it acts on several
of them, or so strongly on one that its flanks show on the others.
"""

import numpy as np

from sim2real.compared.point import Point
from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit
from sim2real.search.following import Following
from sim2real.search.hypotheses import RESONANCES

LINES = 2.0  # effective number of lines on which a resonance must act
FLANKS = 30.0  # or cost that it must save on all lines but the one on which it acts most, where all else follows


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
    return any(
        np.isfinite(c).all() and lines_of(problem, c) < LINES and flanks(problem, fit, name, c) < FLANKS
        for name, c in zip(names, changes, strict=True)
    )


def flanks(problem: Problem, fit: Fit, name: str, change: np.ndarray) -> float:
    """What a resonance of a fit saves on all lines but the one on which it acts most; 0 where the Jacobian is unknown.

    Args:
        problem: the recordings.
        fit: the fit.
        name: the resonance.
        change: of the prediction (K,) without it.
    """
    if fit.jacobian is None:
        return 0.0
    power = _power(problem, change)
    most = max(power, key=lambda line: power[line])
    on = np.zeros(change.size, bool)
    for part in problem.parts:
        numbers = zip(part.record.frequency[part.used], part.record.lines[part.used], strict=True)
        here = np.array([(float(f), float(n)) == most for f, n in numbers])
        on[part.place] = np.broadcast_to(here, (*part.measured.shape[:2], here.size)).reshape(-1)
    h = fit.hypothesis
    kept = np.array([c.effect != name for c in h.coordinates] + [not n.startswith(f"{name}.") for n in h.calibrated])
    beside = Following(fit.jacobian[kept][:, ~on], fit.prior[kept], fit.u[kept], fit.residual[~on])
    return beside.cost(change[~on]) - beside.cost(np.zeros(np.sum(~on), complex))


def lines_of(problem: Problem, change: np.ndarray) -> float:
    """Effective number of lines over which the power of a change (K,) of the prediction is spread: the square of its
    sum over the sum of its squares. A line is the same one in all recordings of a rate and a period."""
    each = np.array(list(_power(problem, change).values()))
    return float(each.sum() ** 2 / np.sum(each**2)) if each.any() else 0.0


def _power(problem: Problem, change: np.ndarray) -> dict[tuple[float, ...], float]:
    """Power of a change (K,) of the prediction on each line, by frequency and number."""
    power: dict[tuple[float, ...], float] = {}
    for part in problem.parts:
        own = (abs(change[part.place]) ** 2).reshape(*part.measured.shape[:2], -1).sum(axis=(0, 1))
        numbers = part.record.lines[part.used]
        for frequency, number, p in zip(part.record.frequency[part.used], numbers, own, strict=True):
            key = (float(frequency), float(number))
            power[key] = power.get(key, 0.0) + float(p)
    return power
