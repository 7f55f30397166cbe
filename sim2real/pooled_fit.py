"""The fit of one rig to many recordings, repeated until noise and drives are those that it ends with."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from maglev_env.loop.effect import effect_value, meaningful
from maglev_env.rig.rig import Rig
from sim2real.coefficients import UNITS, misfit
from sim2real.compared.point import tolerances, unseen_by_all
from sim2real.compared.problem import Problem, assemble
from sim2real.recorded.not_stable import not_stable
from sim2real.recorded.nuisances import Nuisances
from sim2real.recorded.open_evidence import exact_errors
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import REPLACED, Hypothesis
from sim2real.search.valleys import held_aside
from sim2real.search.where_it_stands import where_it_stands
from sim2real.second_body import BODY

MOST_STEPS = 20  # of one pass
PASSES, MOST_PASSES = 2, 8  # of the fit to recordings without a period
WORSE = 3.0  # -2 ln likelihood by which a pass may come out worse than the best one before it
SETTLED = 0.3  # standard errors, widened for what the model leaves, that a coordinate may move in the last pass


def fitted(
    records: Sequence[Record | OpenRecord], near: Fit | None = None, rest: bool = False
) -> tuple[Problem, Fit, list[Fit]]:
    """The problem, its fit, and the nominal rig and the start in the same problem.

    Args:
        records: of one campaign.
        near: a fit of the same rig to begin with, where the rotor stands there; a second body that it has stays.
        rest: whether the means of a mass at rest are used.

    Raises:
        ValueError: the rotor touches down in the simulation with the parameters of the start.
    """
    rig = records[0].nominal
    hidden = unseen_by_all(records)
    names = [
        name for name in (*UNITS, *_poles_left_out(rig)) if meaningful(name, rig.capabilities) and name not in hidden
    ]
    more = () if near is None else tuple(name for name in near.hypothesis.effects if name == BODY)
    allowed = {name: sigma for name, sigma in tolerances(rig).items() if name not in UNITS}
    given = {} if near is None else near.hypothesis.given
    h = Hypothesis((*names, *more), allowed, scales=rig.scales, given=given)
    nominal = _of_rig(h, rig)
    u = nominal if near is None else _carried(h, near)
    problem = assemble(records, near=None if near is None else h.point(u), rest=rest, for_estimate=True)
    start = u
    least = PASSES if near is None else 1
    opened, stood = any(isinstance(r, OpenRecord) for r in records), None
    best: tuple[float, Problem, np.ndarray] | None = None
    for count in range(1, (MOST_PASSES if opened else least) + 1):
        (fit,) = begin([h], [u], problem.data, problem.simulate)
        if not np.isfinite(fit.cost):
            if stood is None and near is not None:
                return fitted(records, None, rest)
            if stood is not None:
                problem, u = stood  # under drives that were put right further, the rotor falls
                break
            if (found := where_it_stands(problem, h)) is None:
                raise ValueError(_lost(rig, records, problem, h, u))
            fit, u = found, found.u
        reached = fit.cost + problem.log_noise
        if best is not None and reached > best[0] + WORSE:
            problem, u = _followed_less_far(*best[1:], h)
            break
        if opened and (best is None or reached < best[0]):
            best = reached, problem if stood is None else stood[0], u
        iterate([fit], problem.data, problem.simulate, MOST_STEPS)
        before, u = u, fit.u
        stood = problem, u
        if opened:
            problem, u = _about(problem, h, u)
        sure = np.sqrt(np.maximum(max(misfit(fit), 1.0) * np.diag(fit.covariance()), 1e-300))
        moved = np.abs(u - before) / sure
        if count >= least and (moved < SETTLED).all():
            break
    else:
        if best is not None and _unlikely(problem, h, u) > best[0] + WORSE:
            problem, u = _followed_less_far(*best[1:], h)
    problem, u = _opened_nearer(problem, h, u, start)
    starts = [nominal] if near is None else [nominal, start]
    fit, *others = begin([h] * (1 + len(starts)), [u, *starts], problem.data, problem.simulate)
    differentiate([fit], problem.data, problem.simulate, True)
    return problem, fit, [*others, *held_aside(problem, fit)]


def _followed_less_far(problem: Problem, u: np.ndarray, h: Hypothesis) -> tuple[Problem, np.ndarray]:
    """The problem in which the likeliest point (size,) was found, with the noise that is left there, and its fit.

    Errors of a measured drive that are put right further only looked like a gain from there. Problems about points
    along a bent valley each end a step further in it, while what is left of the records grows.
    """
    problem = problem.again(h.point(u))
    (fit,) = begin([h], [u], problem.data, problem.simulate)
    iterate([fit], problem.data, problem.simulate, MOST_STEPS)
    return problem, fit.u


def _opened_nearer(problem: Problem, h: Hypothesis, u: np.ndarray, start: np.ndarray) -> tuple[Problem, np.ndarray]:
    """The problem and coordinates (size,) of its fit, or those about a rotor that moves as it does at the start, where
    that is more likely.

    Records of a large motion are opened at the rig of the last pass. Where little moves the rotor, that rig may go
    after the fit from pass to pass, away from where more was explained: each pass alone is an improvement.
    """
    if not any(isinstance(p.record, OpenRecord) and p.record.along is not None for p in problem.parts):
        return problem, u
    back = np.array(u)
    for i, c in enumerate(h.coordinates):
        if c.effect in UNITS and c.effect != "delay":
            back[i] = start[i]
    other = problem.about(h.point(back))
    if not _unlikely(other, h, back) < _unlikely(problem, h, u):
        return problem, u
    (nearer,) = begin([h], [back], other.data, other.simulate)
    iterate([nearer], other.data, other.simulate, MOST_STEPS)
    return other, nearer.u


def _unlikely(problem: Problem, h: Hypothesis, u: np.ndarray) -> float:
    """-2 ln of the likelihood of a point (size,), except for a constant of the records; inf where the rotor falls."""
    (fit,) = begin([h], [u], problem.data, problem.simulate)
    return fit.cost + problem.log_noise


def _of_rig(h: Hypothesis, rig: Rig) -> np.ndarray:
    """Coordinates (size,) of the nominal rig: those of the effects that it has of its own, and 0 of all else."""
    u = np.zeros(h.size)
    for i, c in enumerate(h.coordinates):
        if c.effect in rig.effects:
            u[i] = c.to_bounds(c.at(effect_value(rig.effects, c.effect, c.parameter)))
    return u


def _carried(h: Hypothesis, near: Fit) -> np.ndarray:
    """Coordinates (size,) of a hypothesis at a fit of another one; 0 of what that lacks. Of one recording alone fewer
    effects may show than of all together."""

    def named(other: Hypothesis) -> list[tuple[str, str]]:
        return [(c.effect, c.parameter) for c in other.coordinates] + [("", name) for name in other.calibrated]

    known = dict(zip(named(near.hypothesis), near.u, strict=True))
    return np.array([known.get(name, 0.0) for name in named(h)])


def _about(problem: Problem, h: Hypothesis, u: np.ndarray) -> tuple[Problem, np.ndarray]:
    """The problem with the noise that a good simulation leaves and the errors of drives as they come out at a point,
    and coordinates (size,) of a point that explains the same with a smaller error.

    Where the measured current drives every recording, its scale only multiplies the actuator's gain. Linearised, the
    scale leaves that valley after a short step, so a fit that once went far along it would return in many passes only.
    """
    moved, records = problem.about(h.point(u)), [part.record for part in problem.parts]
    drives = [[e for e in exact_errors(r) if e.scale] if isinstance(r, OpenRecord) else [] for r in records]
    scales = {e.name: e.scale for own in drives for e in own}
    if not scales or not all(drives):
        return moved, u
    common = float(np.mean([moved.errors.get(name, 0.0) * scale for name, scale in scales.items()]))
    at = next(i for i, c in enumerate(h.coordinates) if c.effect == "actuator_gain")
    gain, same = h.coordinates[at], np.array(u)
    same[at] = gain.to_bounds(gain.at((1 + gain.value(float(u[at]))) * (1 + common) - 1))
    errors = {name: moved.errors.get(name, 0.0) - common / scale for name, scale in scales.items()}
    return moved.with_errors(h.point(same), {**moved.errors, **errors}), same


def _lost(rig: Rig, records: Sequence[Record | OpenRecord], problem: Problem, h: Hypothesis, u: np.ndarray) -> str:
    """What is said where the rotor touches down."""
    apart = replace(problem, nuisances=Nuisances((), problem.nuisances.columns[:0]))  # else all are lost
    (found,) = apart.simulate([h.point(u)])
    lost = [p.record.name for p in problem.parts if not np.isfinite(found[p.place]).all()]
    wrong = next(filter(None, (not_stable(r.experiment) for r in records if r.name in lost)), None)
    why = wrong or "check gains, units and the sign of the displacement, or leave these recordings out"
    return f"rig {rig.name}: the rotor touches down in the simulation of {', '.join(lost)}; {why}"


def _poles_left_out(rig: Rig) -> tuple[str, ...]:
    """Effects that stand for time constants of which the rig states neither a value nor that they are zero.

    Every rig has these poles. One that its file leaves out is not known to be zero, and a fit without it would explain
    its gain and phase by the other coefficients. It is fitted with them and shown only in their intervals.
    """
    return tuple(
        effect for effect, name in REPLACED.items() if not getattr(rig, name) and rig.tolerance.get(name) != 0.0
    )
