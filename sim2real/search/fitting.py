"""Least squares of many hypotheses at once: every trial step and every Jacobian column is a lane of the simulator."""

from collections.abc import Callable, Sequence

import numpy as np

from sim2real.compared.point import Point
from sim2real.search.fit import EDGE, Fit, cost_of, real_product
from sim2real.search.hypotheses import Hypothesis

Simulate = Callable[[Sequence[Point]], np.ndarray]  # (n, K) complex, whitened; nan where the rotor touched down
REFRESH = 2  # steps after which the Jacobian's rows of the tolerances are computed again
STEP, CALIBRATION_STEP = 0.004, 0.04  # of finite differences, in coordinates and in tolerances
# Factors on the Levenberg-Marquardt parameter that every iteration tries. They span decades because a valley of the
# cost may be a thousand times as long as it is wide, where one parameter does nearly what others do together.
DAMPING = (1e-3, 0.05, 3.0)
CONVERGED, SHARE = 0.3, 1e-5  # gain of a step that counts as converged: absolute cost, and share of the cost
FAR = 4.0  # tolerances that one step may move, added to the distance already covered
REFUSED, SHORTER = 4, 30.0  # how often shorter steps are tried, and the factor on the damping that shortens them
# A fit is abandoned when it is far behind the best: steps before this is tested, share of the best saving that it may
# be behind, factor on that share per step, and cost that it may be behind in any case.
PATIENCE, HOPELESS, KEEPING_UP, SMALL = 3, 0.4, 0.65, 100.0
# A valley bends where a step gains so many times less than the linear prediction, and that promises so many times more
# than what counts as converged. Then a parabola is followed, whose bend is simulated at PROBE of the undamped step, to
# these shares of it.
BENT, MUCH, PROBE, ALONG = 5.0, 10.0, 0.1, (0.03, 0.1, 0.3)
HOPE = 2.0  # times what a linear prediction promises that a fit may still gain


def share_calibrations(fits: Sequence[Fit], known: Fit) -> None:
    """Start with the Jacobian's tolerance rows of another fit, because they hardly depend on a small effect.

    Fits with coordinates that the other one lacks, as those of forms, begin without.
    """
    if known.jacobian is None or not np.isfinite(known.cost):
        return
    first = len(known.hypothesis.coordinates)
    rows = dict(zip(known.hypothesis.calibrated, known.jacobian[first:], strict=True))
    for fit in fits:
        own, names = len(fit.hypothesis.coordinates), fit.hypothesis.calibrated
        if not rows.keys() >= set(names):
            continue
        fit.jacobian = np.zeros((fit.hypothesis.size, fit.residual.size), complex)
        for i, name in enumerate(names, own):
            fit.jacobian[i] = rows[name]


def begin(hypotheses: Sequence[Hypothesis], u: Sequence[np.ndarray], data: np.ndarray, simulate: Simulate) -> list[Fit]:
    """Fits at given coordinates, without Jacobians; the cost is inf where the rotor touches down."""
    if not hypotheses:
        return []
    u = [h.bounded(v) for h, v in zip(hypotheses, u, strict=True)]
    predicted = simulate([h.point(v) for h, v in zip(hypotheses, u, strict=True)])
    fits = []
    for h, v, p in zip(hypotheses, u, predicted, strict=True):
        fit = Fit(h, v, data - p, np.inf)
        if np.isfinite(p).all():
            fit.cost = cost_of(fit.residual, v, fit.prior)
        fits.append(fit)
    return fits


def differentiate(fits: Sequence[Fit], data: np.ndarray, simulate: Simulate, calibrations: bool) -> None:
    """Fill in the Jacobian's rows of the effects' parameters and, with `calibrations`, those of the tolerances."""
    jobs: list[tuple[Fit, int, float]] = []
    for fit in fits:
        free = len(fit.hypothesis.coordinates)
        if fit.jacobian is None:
            fit.jacobian = np.zeros((fit.hypothesis.size, data.size), complex)
        for i in range(fit.hypothesis.size if calibrations else free):
            jobs.append((fit, i, max(STEP, STEP * abs(fit.u[i])) if i < free else CALIBRATION_STEP))
    if not jobs:
        return
    fallen = [(fit, i, -step) for fit, i, step in _columns(jobs, data, simulate)]
    _columns(fallen, data, simulate)  # where the rotor touches down at one side it may not at the other one
    for fit in fits:
        fit.fresh = calibrations
        fit.age = 0 if calibrations else fit.age + 1


def _columns(
    jobs: Sequence[tuple[Fit, int, float]], data: np.ndarray, simulate: Simulate
) -> list[tuple[Fit, int, float]]:
    """Fill in rows of Jacobians by steps of these coordinates; those with which the rotor touches down are returned.

    Their rows are zero, as those of what is held.
    """
    moved = [aside(fit, i, step) for fit, i, step in jobs]
    for fit, i, _ in jobs:
        fit.jacobian[i] = 0.0
    able = [(fit, i, step, u) for (fit, i, step), u in zip(jobs, moved, strict=True) if u[i] != fit.u[i]]
    predicted = simulate([fit.hypothesis.point(u) for fit, _, _, u in able]) if able else []
    fallen = []
    for (fit, i, step, u), p in zip(able, predicted, strict=True):
        change = (p - (data - fit.residual)) / (u[i] - fit.u[i])
        if np.isfinite(change).all():
            fit.jacobian[i] = change
        else:
            fallen.append((fit, i, step))
    return fallen


def aside(fit: Fit, i: int, step: float) -> np.ndarray:
    """Coordinates (size,) of which one is a step away, or as far in the other direction where its range ends before."""
    for signed in (step, -step):
        moved = fit.u.copy()
        moved[i] += signed
        bounded = fit.hypothesis.bounded(moved)
        if abs(bounded[i] - moved[i]) < 0.5 * abs(step):
            break
    return bounded


def iterate(
    fits: Sequence[Fit], data: np.ndarray, simulate: Simulate, most: int, below: Sequence[float] | None = None
) -> None:
    """Levenberg-Marquardt steps of all fits together; the rows of the tolerances are refreshed now and then.

    A fit ends when two successive steps gain no more than CONVERGED, promise no more, or find no lower point with
    shorter steps; the second of them must use fresh rows throughout. A fit is also abandoned when it is behind the best
    by more than a share of what the best has saved, and when it need not be known because it will not matter. In the
    first PATIENCE steps HOPE times what a linear prediction promises counts as gained; then the share shrinks at every
    step.

    Args:
        fits: Fits; changed in place.
        data: Whitened data (K,).
        simulate: Predicts the data at points.
        most: Largest number of steps.
        below: Cost that each fit must promise to come below to be followed; by default all are.
    """
    floor = [np.inf] * len(fits) if below is None else below
    asked = {id(f): cost for f, cost in zip(fits, floor, strict=True)}
    begun = max((min(f.cost, asked[id(f)]) for f in fits if np.isfinite(f.cost)), default=np.inf)
    for iteration in range(most):
        least = min((f.cost for f in fits), default=np.inf)
        behind = HOPELESS * KEEPING_UP ** max(iteration - PATIENCE, 0) * max(begun - least, 0.0) + SMALL
        if iteration >= PATIENCE:
            for f in fits:
                f.done = f.done or (f.cost - least > behind and not f.refused)
        active = [f for f in fits if not f.done and np.isfinite(f.cost)]
        if not active:
            return
        moved = [f for f in active if not f.fresh]
        stale = [f for f in moved if f.jacobian is None or f.age >= REFRESH or f.refused]
        differentiate(stale, data, simulate, True)
        differentiate([f for f in moved if f not in stale], data, simulate, False)
        equations = {id(f): (f.normal, f.gradient) for f in active}
        undamped = {id(f): _solved(f, *equations[id(f)], 0.0) for f in active}
        promised = {id(f): float(undamped[id(f)] @ equations[id(f)][1]) for f in active}
        for f in active:
            hoped = f.cost - HOPE * promised[id(f)]
            late = 0 < iteration < PATIENCE and hoped - least > behind
            f.done = not f.refused and (late or hoped > asked[id(f)])
        active = [f for f in active if not f.done]
        if not active:
            return
        trials = [
            (f, f.damping * factor, u)
            for f in active
            for factor, u in zip(DAMPING, _steps(f, *equations[id(f)]), strict=True)
        ]
        valleys = [(f, equations[id(f)][0], undamped[id(f)]) for f in active if f.bent and not f.age]
        trials += _along_valleys(valleys, data, simulate)
        predicted = simulate([f.hypothesis.point(u) for f, _, u in trials])
        best: dict[int, tuple[float, float, np.ndarray, np.ndarray]] = {}
        for (f, damping, u), p in zip(trials, predicted, strict=True):
            if np.isfinite(p).all():
                cost = cost_of(data - p, u, f.prior)
                if cost < best.get(id(f), (f.cost,))[0]:
                    best[id(f)] = cost, damping, u, data - p
        for f in active:
            little = CONVERGED + SHARE * f.cost
            gained = f.cost - best[id(f)][0] if id(f) in best else 0.0
            f.bent = promised[id(f)] > max(BENT * gained, MUCH * little)
            if id(f) in best:
                f.refused = 0
                idle = min(promised[id(f)], gained) < little
            else:
                f.refused += 1
                idle = promised[id(f)] < little or f.refused > REFUSED
            f.done = idle and f.idle and f.age == 0
            f.idle = idle
            if idle and (id(f) in best or not f.fresh):
                f.age = REFRESH  # only fresh rows can show whether anything is left to gain
            if id(f) not in best:
                f.damping *= SHORTER
                continue
            u, residual, f.fresh = f.u, f.residual, False
            f.cost, f.damping, f.u, f.residual = best[id(f)]
            moved = f.u - u  # Broyden update: what the step revealed about rows that are not computed again
            f.jacobian += np.outer(moved, residual - f.residual - moved @ f.jacobian) / max(moved @ moved, 1e-300)


def _along_valleys(
    valleys: Sequence[tuple[Fit, np.ndarray, np.ndarray]], data: np.ndarray, simulate: Simulate
) -> list[tuple[Fit, float, np.ndarray]]:
    """Trial points along a parabola through each fit's point: its undamped step, bent as a further simulation shows.

    A straight step soon leaves a narrow valley of the cost that bends. After Transtrum and Sethna (2012), "Improvements
    to the Levenberg-Marquardt algorithm for nonlinear least-squares minimization" (geodesic acceleration).

    Args:
        valleys: Fits whose rows are fresh, each with the matrix of its normal equations and its undamped step.
        data: Whitened data (K,).
        simulate: Predicts the data at points.
    """
    if not valleys:
        return []
    straight = [within_reach(f.hypothesis, f.u, step) for f, _, step in valleys]
    probes = [f.hypothesis.bounded(f.u + PROBE * v) for (f, *_), v in zip(valleys, straight, strict=True)]
    predicted = simulate([f.hypothesis.point(u) for (f, *_), u in zip(valleys, probes, strict=True)])
    found = []
    for (f, normal, _), v, probe, p in zip(valleys, straight, probes, predicted, strict=True):
        if not np.isfinite(p).all():
            continue
        bend = 2.0 * (p - (data - f.residual) - (probe - f.u) @ f.jacobian) / PROBE**2
        turn = -_solved(f, normal, real_product(f.jacobian, bend), 0.0)
        found += [(f, f.damping, f.hypothesis.bounded(f.u + t * v + 0.5 * t**2 * turn)) for t in ALONG]
    return found


def _steps(fit: Fit, normal: np.ndarray, gradient: np.ndarray) -> list[np.ndarray]:
    """Bounded trial points, one for each damping tried."""
    h, u = fit.hypothesis, fit.u
    steps = (_solved(fit, normal, gradient, fit.damping * factor) for factor in DAMPING)
    return [h.bounded(u + within_reach(h, u, step)) for step in steps]


def within_reach(hypothesis: Hypothesis, u: np.ndarray, step: np.ndarray) -> np.ndarray:
    """A step (size,) from u, shortened as a whole to where a single step may go."""
    return step / np.max(abs(step) / reach(hypothesis, u), initial=1.0)


def reach(hypothesis: Hypothesis, u: np.ndarray) -> np.ndarray:
    """How far a single step may go from u, (size,)."""
    own = [c.reach(v) for c, v in zip(hypothesis.coordinates, u, strict=False)]
    return np.concatenate([own, FAR + abs(u[len(own) :])])


def _solved(fit: Fit, normal: np.ndarray, gradient: np.ndarray, damping: float) -> np.ndarray:
    """The damped step (size,) of a fit's normal equations; coordinates that would cross a bound at once stay fixed."""
    normal = normal + damping * np.diag(np.diag(normal) + 1e-12)
    inside = np.ones(gradient.size, bool)
    while True:
        step = np.zeros_like(gradient)
        at = np.flatnonzero(inside)
        step[at] = np.linalg.lstsq(normal[np.ix_(at, at)], gradient[at], rcond=None)[0]
        nudged = fit.u + EDGE * np.sign(step)
        crossed = inside & (step != 0) & (fit.hypothesis.bounded(nudged) == fit.u)
        if not crossed.any():
            return step
        inside &= ~crossed
