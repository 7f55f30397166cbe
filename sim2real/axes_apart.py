"""Coefficients of a rig with two axes that are not the same along both.

One fit moves a coefficient of both axes by the same share. Where the axes differ by more than noise, what comes out
lies somewhere between them, with the standard error of a quantity that does not exist. So each axis is also fitted by
what shows along it alone. Where these fits differ, all coefficients are theirs.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from maglev_env.loop.axes import AXES
from maglev_env.rig.rig import Rig, axis_rig
from sim2real.coefficients import Coefficient, coefficients_of
from sim2real.compared.point import Point
from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit, cost_of
from sim2real.search.fitting import differentiate, iterate
from sim2real.words import quantity

CLEAR = 3.0  # standard errors from which the axes differ
STEPS = 6  # of a fit of a part, which begins at that of all


def along_both(
    rig: Rig, problem: Problem, fit: Fit, others: Sequence[Fit]
) -> tuple[tuple[Coefficient, ...], tuple[str, ...]]:
    """Coefficients of a fit (see `coefficients_of`), and a sentence about each that differs between two axes."""
    whole = coefficients_of(rig, problem, fit, others)
    if rig.axes == 1:
        return whole, ()
    x, y = (_along(rig, problem, fit, axis) for axis in range(rig.axes))
    told = [a.identified and b.identified for a, b in zip(x, y, strict=True)]
    # Where the rig states other values of its axes, they agree if both are as far from these.
    as_one = [(_beside(a, c.nominal), _beside(b, c.nominal)) for c, a, b in zip(whole, x, y, strict=True)]
    apart = [sure and _apart(*both) for both, sure in zip(as_one, told, strict=True)]
    said = [_stated(a, b) for a, b, sure in zip(x, y, told, strict=True) if sure and a.nominal != b.nominal]
    if not any(apart):
        return whole, tuple(said)
    found = tuple(_of_both(*both) if sure else c for c, both, sure in zip(whole, as_one, told, strict=True))
    said += [_in_words(a, b) for a, b, differ in zip(x, y, apart, strict=True) if differ]
    return found, tuple(said)


def _beside(c: Coefficient, nominal: float) -> Coefficient:
    """A coefficient of an axis as if its nominal value were another one."""
    factor = nominal / c.nominal if c.nominal else 1.0
    return replace(c, value=c.value * factor, se=c.se * abs(factor), nominal=nominal)


def _apart(x: Coefficient, y: Coefficient) -> bool:
    return abs(x.value - y.value) > CLEAR * float(np.hypot(x.se, y.se))


def _of_both(x: Coefficient, y: Coefficient) -> Coefficient:
    """One coefficient for two axes: the mean where they agree, else the middle, whose interval reaches both."""
    if _apart(x, y):
        reach = float(stats.norm.isf(0.025))
        return replace(x, value=(x.value + y.value) / 2).with_error(
            abs(x.value - y.value) / 2 / reach + max(x.se, y.se)
        )
    weights = np.array([x.se, y.se]) ** -2.0 if x.se > 0 and y.se > 0 else np.ones(2)
    value = float(weights @ [x.value, y.value] / weights.sum())
    return replace(x, value=value).with_error(max(x.se, y.se))  # of the mass and its like, both share the error


def _shown(x: Coefficient, y: Coefficient) -> str:
    shown = " and ".join(f"{quantity(c.value, c.se, c.unit)} along {n}" for c, n in zip((x, y), AXES, strict=True))
    return f"{x.name.replace('_', ' ')} is {shown}"


def _stated(x: Coefficient, y: Coefficient) -> str:
    return f"{_shown(x, y)}; the rig states other values of its axes, and the table has their means"


def _in_words(x: Coefficient, y: Coefficient) -> str:
    return (
        f"{_shown(x, y)}: no value holds for both axes, and the interval "
        "reaches both; state what differs in [axis.x] and [axis.y] of the rig"
    )


def _along(rig: Rig, problem: Problem, fit: Fit, axis: int) -> tuple[Coefficient, ...]:
    """Coefficients by what shows along one axis."""
    own = problem.axis == axis
    return coefficients_of(axis_rig(rig, axis), problem, fit_of_rows(problem, fit, own), [], float(own.mean()))


def fit_of_rows(problem: Problem, fit: Fit, rows: np.ndarray) -> Fit:
    """A fit by a part of the data (K,), which begins at that of all, with its Jacobian; its residual is zero in the
    others."""
    own = rows.astype(float)
    residual, jacobian = fit.residual * own, None if fit.jacobian is None else fit.jacobian * own

    def simulate(points: Sequence[Point]) -> np.ndarray:
        return problem.simulate(points) * own

    data = problem.data * own
    alone = Fit(fit.hypothesis, fit.u, residual, cost_of(residual, fit.u, fit.prior), jacobian, fresh=fit.fresh)
    iterate([alone], data, simulate, STEPS)
    if not alone.fresh:
        differentiate([alone], data, simulate, True)
    return alone
