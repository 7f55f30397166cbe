"""Least squares of many hypotheses at once: every trial step and every Jacobian column is a lane of the simulator."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sim2real.compared.simulated import Point
from sim2real.search.hypotheses import Hypothesis

Simulate = Callable[[Sequence[Point]], np.ndarray]  # (n, K) complex, whitened; nan where the rotor touched down
REFRESH = 2  # steps after which the Jacobian's rows of the tolerances are computed again
STEP, CALIBRATION_STEP = 0.004, 0.04  # of finite differences, in coordinates and in tolerances
# Factors on the Levenberg-Marquardt parameter that every iteration tries. They span decades because a valley of the
# cost may be a thousand times as long as it is wide, where one parameter does nearly what others do together.
DAMPING = (1e-3, 0.05, 3.0)
CONVERGED, SHARE = 0.3, 1e-5  # gain of a step that counts as converged: absolute cost, and share of the cost
EDGE = 1e-6  # distance, in coordinates, within which a bound counts as reached
FAR = 4.0  # tolerances that one step may move, added to the distance already covered
REFUSED, SHORTER = 4, 30.0  # how often shorter steps are tried, and the factor on the damping that shortens them
# A fit is abandoned when it is far behind the best: steps before this is tested, share of the best saving that it may
# be behind, factor on that share per step, and cost that it may be behind in any case.
PATIENCE, HOPELESS, KEEPING_UP, SMALL = 3, 0.4, 0.65, 100.0
# Cost of a further parameter of an effect: what noise lets it save of further records, and the judge's.
PARAMETER = 6.0
NOT_TOLD = 1e6  # coordinates: standard error of one that nothing tells
# Share of the largest eigenvalue below which a combination of coordinates is not told, and least share of such a
# combination that one of them must have not to be told either.
SINGULAR, SHARED = 1e-14, 1e-6
HOPE = 2.0  # times what a linear prediction promises that a fit may still gain


@dataclass(eq=False)
class Fit:
    """A hypothesis at coordinates u.

    The cost is sum |r|^2 plus the sum of the squared changes in units of their tolerances: -2 ln of the likelihood
    except for a constant. A complex residual counts twice; |r|^2 is scaled to variance 1 per real part.

    Attributes:
        hypothesis: The hypothesis.
        u: Coordinates (size,).
        residual: Whitened complex residual (K,).
        cost: Cost at u.
        jacobian: Derivative (size, K) of the prediction; None while unknown.
        damping: Levenberg-Marquardt parameter.
        age: Steps since the tolerances' rows were computed.
        refused: Consecutive iterations without a lower trial step, as where all of them touch down.
        fresh: Whether all rows were computed at u.
        idle: Whether the last iteration gained too little.
        done: Whether the fit has ended.
    """

    hypothesis: Hypothesis
    u: np.ndarray
    residual: np.ndarray
    cost: float
    jacobian: np.ndarray | None = None
    damping: float = 1e-3
    age: int = 0
    refused: int = 0
    fresh: bool = False
    idle: bool = False
    done: bool = False

    @property
    def prior(self) -> np.ndarray:
        return self.hypothesis.prior

    @property
    def normal(self) -> np.ndarray:
        """Hessian of half the cost, (size, size)."""
        return real_product(self.jacobian, self.jacobian) + np.diag(self.prior)

    @property
    def gradient(self) -> np.ndarray:
        """Negative gradient of half the cost, (size,)."""
        return real_product(self.jacobian, self.residual) - self.prior * self.u

    @property
    def occam(self) -> float:
        """Cost of the freedom of forms: by how much the data narrow the priors of their coordinates (Laplace's method).

        It is minus twice the logarithm of the ratio of volumes. Coordinates at a bound cost nothing.
        """
        h = self.hypothesis
        if not h.shapes or self.jacobian is None:
            return 0.0
        at = [len(h.coordinates) + h.calibrated.index(name) for name in h.shapes]
        nudges = (h.bounded(self.u + EDGE), h.bounded(self.u - EDGE))
        inside = [i for i in at if all(abs(v[i] - self.u[i]) > 0.5 * EDGE for v in nudges)]
        return -float(np.linalg.slogdet(self.covariance()[np.ix_(inside, inside)])[1]) if inside else 0.0

    @property
    def charged(self) -> np.ndarray:
        """Share of the cost of a parameter that each coordinate of an effect has, (coordinates,).

        The first one of an effect has all. With an end of its range for a constant instead of a further one, the effect
        explains less by the square of its distance in standard errors, to second order, and costs a parameter less: it
        is charged what is less.
        """
        own = self.hypothesis.coordinates
        found = np.ones(len(own))
        if self.jacobian is None:
            return found
        sd = self.spread
        for i, (before, c) in enumerate(pairwise(own), 1):
            if before.effect == c.effect:
                found[i] = min((c.to_end(float(self.u[i])) / sd[i]) ** 2 / PARAMETER, 1.0) if sd[i] else 1.0
        return found

    def covariance(self) -> np.ndarray:
        """Covariance of the coordinates, (size, size)."""
        return inverse(self.normal)

    @property
    def excess(self) -> float:
        """Cost beyond the noise."""
        return self.cost - 2.0 * self.residual.size

    @property
    def spread(self) -> np.ndarray:
        """Standard errors (size,) by the curvature.

        NOT_TOLD where that is none, as where the rotor falls beside, and of coordinates of which only a combination is
        told.
        """
        scaled, _ = _scaled(self.normal)
        values, vectors = np.linalg.eigh(scaled)
        lost = np.sum(vectors[:, values <= SINGULAR * values.max(initial=0.0)] ** 2, axis=1)
        told = (np.diag(self.normal) > 0) & (lost < SHARED)
        return np.where(told, np.sqrt(np.diag(self.covariance())), NOT_TOLD)


def inverse(normal: np.ndarray) -> np.ndarray:
    """Pseudo-inverse of a normal matrix (size, size), whose coordinates may be told to very different accuracies.

    One that is told a billion times better than another would count as all of the matrix, and the other as known.
    """
    scaled, size = _scaled(normal)
    return np.linalg.pinv(scaled, rcond=SINGULAR, hermitian=True) / np.outer(size, size)


def _scaled(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A normal matrix with ones on its diagonal, and what each coordinate was divided by."""
    size = np.sqrt(np.diag(normal))
    size = np.where(size > 0, size, 1.0)
    return normal / np.outer(size, size), size


def real_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Re(a b^H) of complex rows (..., K): as real numbers it takes a quarter of the time."""
    rows, columns = (np.ascontiguousarray(v, complex).view(float) for v in (a, b))
    return rows @ columns.T


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


def cost_of(residual: np.ndarray, u: np.ndarray, prior: np.ndarray) -> float:
    return float(np.vdot(residual, residual).real + prior @ u**2)


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
    points: list[Point] = []
    for fit in fits:
        free = len(fit.hypothesis.coordinates)
        if fit.jacobian is None:
            fit.jacobian = np.zeros((fit.hypothesis.size, data.size), complex)
        for i in range(fit.hypothesis.size if calibrations else free):
            step = max(STEP, STEP * abs(fit.u[i])) if i < free else CALIBRATION_STEP
            for signed in (step, -step):
                moved = fit.u.copy()
                moved[i] += signed
                bounded = fit.hypothesis.bounded(moved)
                if abs(bounded[i] - moved[i]) < 0.5 * step:
                    break
            if bounded[i] == fit.u[i]:  # it is held
                fit.jacobian[i] = 0.0
                continue
            jobs.append((fit, i, bounded[i] - fit.u[i]))
            points.append(fit.hypothesis.point(bounded))
    if not jobs:
        return
    for (fit, i, step), predicted in zip(jobs, simulate(points), strict=True):
        change = (predicted - (data - fit.residual)) / step
        fit.jacobian[i] = change if np.isfinite(change).all() else 0.0
    for fit in fits:
        fit.fresh = calibrations
        fit.age = 0 if calibrations else fit.age + 1


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
        promised = {id(f): float(_solved(f, *equations[id(f)], 0.0) @ equations[id(f)][1]) for f in active}
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
        predicted = simulate([f.hypothesis.point(u) for f, _, u in trials])
        best: dict[int, tuple[float, float, np.ndarray, np.ndarray]] = {}
        for (f, damping, u), p in zip(trials, predicted, strict=True):
            if np.isfinite(p).all():
                cost = cost_of(data - p, u, f.prior)
                if cost < best.get(id(f), (f.cost,))[0]:
                    best[id(f)] = cost, damping, u, data - p
        for f in active:
            little = CONVERGED + SHARE * f.cost
            if id(f) in best:
                f.refused = 0
                idle = min(promised[id(f)], f.cost - best[id(f)][0]) < little
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


def _steps(fit: Fit, normal: np.ndarray, gradient: np.ndarray) -> list[np.ndarray]:
    """Bounded trial points, one for each damping tried."""
    found, far = [], reach(fit.hypothesis, fit.u)
    for factor in DAMPING:
        step = _solved(fit, normal, gradient, fit.damping * factor)
        found.append(fit.hypothesis.bounded(fit.u + step / np.max(abs(step) / far, initial=1.0)))
    return found


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
