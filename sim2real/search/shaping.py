"""Other forms of effects: the coordinates of their shapes are freed where the plain formula leaves something."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.following import following
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.shapes import shapes_of

WITHIN = 0.6  # share of what the best fit saves by which others may be behind it and still be tried in other forms
LEAST = 4.0  # cost that a linear prediction must promise
STEPS = 25  # of a fit; one that is a mode begins with too much damping
FEW = 12  # of one that begins beside its minimum
SOUGHT = 2  # places that are followed of those at which what a form adds may lie


def shaped(problem: Problem, unexplained: float, fits: Sequence[Fit], most: int) -> list[Fit]:
    """The fits, the best ones of which may take other forms of their effects where that pays for the freedom.

    Where the best fit leaves no more than what noise leaves on average, it has nothing to gain; another one, which the
    plain formula alone keeps behind it, may.

    Args:
        problem: The problem.
        unexplained: Cost without any effect.
        fits: Fits of hypotheses.
        most: How many are tried in other forms.
    """
    least = min((f.cost for f in fits), default=np.inf)
    enough = least + LEAST if least < 2.0 * problem.data.size else 0.0
    behind = least + WITHIN * (unexplained - least) if np.isfinite(unexplained) else 2.0 * least
    able = [f for f in fits if enough <= f.cost <= behind and np.isfinite(f.cost)]
    able = [f for f in able if free_forms(f) != f.hypothesis.shaped]
    tried = sorted(able, key=lambda f: f.cost)[:most]
    jobs = []
    for f in tried:
        h = replace(f.hypothesis, shaped=free_forms(f))
        jobs += [(f, h, u) for u in (*starts(f, h), *places_of_added(problem, f, h))]
    freed = begin([h for _, h, _ in jobs], [u for *_, u in jobs], problem.data, problem.simulate)
    standing = [(f, new) for (f, *_), new in zip(jobs, freed, strict=True) if np.isfinite(new.cost)]
    differentiate([new for _, new in standing], problem.data, problem.simulate, True)
    pairs = []
    for f in tried:
        own = [(hoped(new), new) for fit, new in standing if fit is f]
        promise, new = min(own, key=lambda each: each[0], default=(np.inf, None))
        if new is not None and promise < f.cost - LEAST:
            pairs.append((f, new))
    iterate([new for _, new in pairs], problem.data, problem.simulate, STEPS)
    better = {id(f): new for f, new in pairs if new.cost + new.occam < f.cost + f.occam}
    return [better.get(id(f), f) for f in fits]


def of_any_form(problem: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """The fits, with all forms of their effects free but for what a form adds, such as a further mode.

    Where a form pays for its freedom, a fit has it. Where it does not, the plain formula is still only one of many, and
    what is fitted beside it has other values under the others: the fit that is given here has the most probable ones,
    and its covariance holds what the data do not tell of the form.
    """
    freed = [_with_forms(f) for f in fits]
    jobs = [(f, h) for f, h in zip(fits, freed, strict=True) if h != f.hypothesis and f.jacobian is not None]
    coordinates = [_extended(f, h.calibrated) for f, h in jobs]
    begun = begin([h for _, h in jobs], coordinates, problem.data, problem.simulate)
    standing = [new for new in begun if np.isfinite(new.cost)]
    iterate(standing, problem.data, problem.simulate, FEW)
    differentiate([new for new in standing if not new.fresh], problem.data, problem.simulate, True)
    better = {id(f): new for (f, _), new in zip(jobs, begun, strict=True) if new.cost <= f.cost}
    return [better.get(id(f), f) for f in fits]


def _with_forms(fit: Fit) -> Hypothesis:
    """The hypothesis of a fit with all forms free but for what those that it has not add."""
    h, free, given = fit.hypothesis, free_forms(fit), {}
    for name in free:
        added = {s.key: s.parameter.default for s in shapes_of(name, h.scales) if s.parameter.added}
        if added and name not in h.shaped:
            given[name] = added
    return replace(h, shaped=free, given={**h.given, **given})


def free_forms(fit: Fit) -> tuple[str, ...]:
    """Effects of a fit that have other forms."""
    return tuple(name for name in fit.hypothesis.effects if shapes_of(name, fit.hypothesis.scales))


def starts(fit: Fit, freed: Hypothesis) -> list[np.ndarray]:
    """Coordinates at which a fit of other forms may start: its own, and with each form moved by a standard deviation.

    About the plain formula a form may do nothing yet, or be at its bound.
    """
    first, found = len(freed.coordinates), [_extended(fit, freed.calibrated)]
    for i, name in enumerate(freed.calibrated, first):
        shape = freed.shapes.get(name)
        if shape and not (np.isinf(shape.parameter.default) or shape.parameter.added):
            for moved in (-1.0, 1.0):
                u = found[0].copy()
                u[i] += moved
                bounded = freed.bounded(u)
                if abs(bounded[i] - found[0][i]) > 0.5:
                    found.append(bounded)
    return found


def _extended(fit: Fit, calibrated: Sequence[str]) -> np.ndarray:
    """Coordinates of a fit, with those of more forms at the centre of their priors."""
    own = len(fit.hypothesis.coordinates)
    known = dict(zip(fit.hypothesis.calibrated, fit.u[own:], strict=True))
    return np.concatenate([fit.u[:own], [known.get(name, 0.0) for name in calibrated]])


def places_of_added(problem: Problem, fit: Fit, freed: Hypothesis) -> list[np.ndarray]:
    """Coordinates at which a fit may start with what a form adds, such as a further mode: of all places where that may
    lie those which promise most, sized to fit the residual best with all else following."""
    first, own = len(freed.coordinates), _extended(fit, freed.calibrated)
    found: list[np.ndarray] = []
    for name in freed.shaped if fit.jacobian is not None else ():
        at = {i: s for i, n in enumerate(freed.calibrated, first) if (s := freed.shapes.get(n)) and s.effect == name}
        places = {i: s for i, s in at.items() if s.parameter.added and s.parameter.starts}
        for size in (i for i, s in at.items() if s.parameter.added and s.parameter.scale and not own[i]):
            tried = []
            for values in product(*(s.parameter.starts for s in places.values())):
                u = own.copy()
                u[size] = at[size].at(at[size].parameter.scale)
                u[[*places]] = [s.at(value) for s, value in zip(places.values(), values, strict=True)]
                tried.append(u)
            predicted = problem.simulate([freed.point(u) for u in tried])
            standing = [i for i, p in enumerate(predicted) if np.isfinite(p).all()]
            matrix, along = following(fit).along(predicted[standing] - (problem.data - fit.residual))
            power = np.maximum(np.diag(matrix), 1e-300)
            wanted = along if at[size].parameter.low < 0 else np.maximum(along, 0.0)
            for i in np.argsort(-(wanted**2) / power)[:SOUGHT]:
                tried[standing[i]][size] *= wanted[i] / power[i]
                found.append(freed.bounded(tried[standing[i]]))
    return found


def hoped(fit: Fit) -> float:
    """The cost that a linear prediction promises."""
    return fit.cost - following(fit).promised
