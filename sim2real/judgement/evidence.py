"""What probabilities are computed from: the costs of fitted candidates, tones, trends, and what the best one leaves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isinf

import numpy as np

from maglev_env.loop.effect import EFFECTS, effect_value
from maglev_env.rig.rig import Rig
from sim2real.compared.commands_seen import SEEN
from sim2real.compared.drift import Drift
from sim2real.compared.point import Point
from sim2real.compared.problem import KINDS, Problem
from sim2real.compared.reached import current_reached, motion_reached
from sim2real.judgement.dispersion import NOISE_ALONE, NOISE_INFLATION, Dispersion, dispersion_of
from sim2real.judgement.lost_commands import LOST, scatter_cost
from sim2real.judgement.meaning.on_one_line import acts_on_one_line
from sim2real.judgement.meaning.outside_meaning import meaningless_cost
from sim2real.judgement.meaning.stated_stiffness import stiffness_cost
from sim2real.judgement.meaning.within_reach import LIMITS, shows_limit
from sim2real.recorded.drifting import DRIFTING, trend
from sim2real.recorded.records import Record
from sim2real.search.candidates import NO_GAP, Attribution, Candidate
from sim2real.search.fit import Fit
from sim2real.search.fitting import differentiate
from sim2real.search.hypotheses import REPLACED, RESONANCES, added_lag

NEAR_BEST = 300.0  # cost above the best within which it is asked whether resonances and friction are shown as such
IDLE = 25.0  # cost that an effect must save to be named although it ended where it changes nothing
SAME = 0.1  # share of an added lag by which a block must be later than stated


@dataclass(frozen=True)
class Evidence:
    """What probabilities are computed from.

    Groups are residuals of the same output, kind of line and octave.

    Attributes:
        effects: Effects of each candidate, calibration first.
        cost: Predictive cost of each candidate; inf where it touches down, contradicts a stated tolerance as a
            pair, is no resonance or one that acts on a single line, has a limit that nothing reaches, or names beside
            another effect one that changes nothing.
        nominal: Cost of the untouched nominal rig.
        excess: Cost of each group beyond the noise, (candidates, G).
        scatter: Scatter (G,) of that cost under noise alone.
        groups: Output, kind and octave (Hz) of each group.
        tones: Chi-square of each family of tones that was found.
        spin: Cost of each effect that may explain what turns with the rotor.
        causes: Cost of each effect that may explain one of the families in `judge.OPEN`.
        dispersion: What the best candidate leaves beyond noise, or one of fewer effects that is as good.
        strain: Part of each candidate's cost that stated parameters make that moved far beyond their tolerance.
        nameless: Least cost of the candidates that name beside another effect one which changes nothing; inf without
            one. A stated constant that moved explains there, which only an unknown cause can stand for.
        refused: What each single effect costs that is refused because it has no meaning where its fit ended, as
            friction that never slides; inf of all others. What acts so has no name.
        motion: Cost of a simulation that stands still, beyond noise. Where the rotor nearly falls without an effect,
            that is far off by more than anything that was measured, and no gap counts for more than the motion.
        at_end: How many parameters of each candidate are not charged, because they are not told from an end of their
            range (`Fit.charged`); None: not known of any.
    """

    effects: tuple[tuple[str, ...], ...]
    cost: np.ndarray
    nominal: float
    excess: np.ndarray
    scatter: np.ndarray
    groups: tuple[tuple[str, str, float], ...]
    tones: Mapping[str, float]
    spin: Mapping[str, float]
    causes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    dispersion: Dispersion = NOISE_ALONE
    strain: np.ndarray | None = None
    nameless: float = inf
    refused: np.ndarray | None = None
    motion: float = inf
    at_end: np.ndarray | None = None


def evidence_of(
    attribution: Attribution,
    tones: Mapping[str, float],
    spin: Mapping[str, float],
    causes: Mapping[str, Mapping[str, float]],
    drift: Drift | None = None,
) -> Evidence:
    """The evidence of fitted candidates, of tones (see `unsynchronised`) and of what periods say of a drift."""
    p, candidates = attribution.problem, attribution.candidates
    cost, nameless, refused = _costs(attribution, drift)
    fits = [c.fit for c in candidates]
    residuals = [fit.residual for fit in fits]
    if not np.isfinite(attribution.calibration.fit.cost):
        residuals[0] = p.opened_residual()  # no rotor levitates without an effect
    at = _plainest(candidates, cost, tones.get(SEEN, 0.0))
    best = fits[at]
    octave = np.floor(np.log2(np.maximum(p.frequency, 1e-9))).astype(int)
    rows = np.stack([p.output, p.kind, octave], axis=1)
    names, label, count = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    excess = [np.bincount(label.reshape(-1), abs(r) ** 2, count.size) - 2.0 * count for r in residuals]
    scatter = NOISE_INFLATION * np.sqrt(4.0 * count)
    noise = float(np.sqrt(np.sum(scatter**2)))
    return Evidence(
        tuple(c.effects for c in candidates),
        cost,
        attribution.nominal,
        np.array(excess),
        scatter,
        tuple((p.outputs[o], KINDS[k], float(2.0**f)) for o, k, f in names),
        dict(tones),
        dict(spin),
        dict(causes),
        NOISE_ALONE if not np.isfinite(cost[at]) or best.jacobian is None else dispersion_of(p, best),
        np.array([_strain(c, bool(e.sum() <= noise)) for c, e in zip(candidates, excess, strict=True)]),
        nameless,
        refused,
        float(np.vdot(p.data, p.data).real - 2.0 * p.data.size),
        np.array([_at_end(c.fit) for c in candidates]),
    )


def _at_end(fit: Fit) -> float:
    """See `Evidence.at_end`; all parameters of an effect that is like another one count as one anyway."""
    own = zip(fit.hypothesis.coordinates, fit.charged, strict=True)
    return float(sum(1 - charged for c, charged in own if not EFFECTS[c.effect].like))


def _plainest(candidates: Sequence[Candidate], cost: np.ndarray, seen: float = 0.0) -> int:
    """The candidate of fewest effects among those as good as the best; seen: what commands weigh that were seen to be
    lost, which only one effect explains.

    Parameters of an effect that is not there are told by noise alone, by every recording otherwise: recordings that
    agree would seem not to.
    """
    cost = cost + np.array([0.0 if LOST in c.effects else seen for c in candidates])
    near = np.flatnonzero(cost < cost.min() + NO_GAP) if np.isfinite(cost).any() else [0]
    return int(min(near, key=lambda i: (len(candidates[i].effects), cost[i])))


def _costs(attribution: Attribution, drift: Drift | None) -> tuple[np.ndarray, float, np.ndarray]:
    """Predictive cost of each candidate with what its parameters contradict, and what has no name, as `Evidence.cost`,
    `Evidence.nameless` and `Evidence.refused`."""
    p, candidates = attribution.problem, attribution.candidates
    rig, reached = p.parts[0].record.nominal, (motion_reached(p), current_reached(p))
    cost, nameless, refused = np.full(len(candidates), inf), inf, np.full(len(candidates), inf)
    on_one_line: dict[int, float] = {}
    told: dict[tuple[int, str], bool] = {}
    _differentiate_simulated(attribution)
    for i, c in enumerate(candidates):
        if c.possible:
            at = c.fit.hypothesis.point(c.fit.u)
            own = c.predictive + scatter_cost(p, c.fit) + stiffness_cost(at, rig)
            own += c.fit.hypothesis.beyond_stated(c.fit.u)
            own += 0.0 if drift is None else _drift_cost(p, c.fit, drift)
            if isinf(meaning := meaningless_cost(c.fit, rig, *reached)) and len(c.effects) == 1:
                refused[i] = own
            own += meaning
            cost[i] = own + (idle := idle_cost(at, c.effects, rig))
            nameless = min(nameless, own) if isinf(idle) else nameless
    for i in np.argsort(cost):  # whatever costs much more than the best is not named anyway
        if cost[i] > cost.min() + NEAR_BEST:
            break
        fit = _differentiated(p, candidates[i].fit)
        limited = all(_limited(attribution, int(i), name, told) for name in candidates[i].effects if name in LIMITS)
        if not limited and len(candidates[i].effects) == 1:
            refused[i] = cost[i]
        if limited and acts_on_one_line(p, fit):
            on_one_line[int(i)] = float(cost[i])
        if not limited or i in on_one_line:
            cost[i] = inf
    for i in as_good_as_others(attribution, cost, on_one_line):
        cost[i] = on_one_line[i]
    return cost, nameless, refused


def _differentiate_simulated(attribution: Attribution) -> None:
    """Differentiate the candidates near the best that were only simulated (see `again`), in place.

    What their forms and further parameters cost is told by their Jacobian; without one, forms would be free.
    """
    p, fits = attribution.problem, [c.fit for c in attribution.candidates if c.possible]
    least = min((f.cost for f in fits), default=inf)
    simulated = [f for f in fits if f.jacobian is None and f.cost < least + NEAR_BEST]
    differentiate(simulated, p.data, p.simulate, True)


def as_good_as_others(attribution: Attribution, cost: np.ndarray, on_one_line: Mapping[int, float]) -> list[int]:
    """Candidates whose resonance acts on one line, beside the same with another resonance that acts on several and
    explains no more: what tells the one from the other is not their shape, and both are a class.

    Args:
        attribution: The fitted candidates.
        cost: Of each candidate; inf of those that are not named.
        on_one_line: Candidate -> its cost, of those whose resonance acts on one line.
    """
    effects = [set(c.effects) for c in attribution.candidates]

    def alike(a: set[str], b: set[str]) -> bool:
        return len(a) == len(b) and a.difference(RESONANCES) == b.difference(RESONANCES)

    return [
        i for i, own in on_one_line.items()
        if any(alike(effects[i], other) and cost[j] < own + NO_GAP for j, other in enumerate(effects))
    ]  # fmt: skip


def _differentiated(problem: Problem, fit: Fit) -> Fit:
    """The fit with its Jacobian, which what follows it and its dispersion need."""
    if fit.jacobian is None and np.isfinite(fit.cost):
        differentiate([fit], problem.data, problem.simulate, True)
    return fit


def _limited(attribution: Attribution, candidate: int, name: str, told: dict[tuple[int, str], bool]) -> bool:
    """Whether a candidate shows the limit of one of its effects; `told` is added to.

    A pair that explains no more than this effect alone shows what that does: with noise it is a long question.
    """
    candidates = attribution.candidates
    alone = next((i for i, c in enumerate(candidates) if c.effects == (name,) and c.possible), candidate)
    if candidates[alone].fit.cost < candidates[candidate].fit.cost + NO_GAP:
        candidate = alone
    if (candidate, name) not in told:
        fit = _differentiated(attribution.problem, candidates[candidate].fit)
        told[candidate, name] = shows_limit(attribution.problem, fit, name, _without(attribution, candidate, name))
    return told[candidate, name]


def _without(attribution: Attribution, candidate: int, name: str) -> float:
    """Cost of a candidate without one of its effects, or with the linear rival of it instead, where that was fitted.

    Else friction beside a damping that does nothing would be shown by a limit that friction alone is refused for.
    """
    rest = {other for other in attribution.candidates[candidate].effects if other != name}
    rival = attribution.of(*rest, LIMITS[name].rival) if LIMITS[name].rival not in rest else None
    return min(attribution.without(candidate, name), np.inf if rival is None else rival.fit.cost)


def _strain(c: Candidate, whole: bool) -> float:
    """What stated parameters cost that moved far beyond their tolerance, beside an effect or as one.

    A single one that is wrong, and by which all recordings then agree with the simulation down to the noise (whole), is
    a wrong statement and no sign of an unknown cause: that would have to do exactly what a number does.
    """
    h, u = c.fit.hypothesis, c.fit.u
    return sum(h.strained(u).values()) + (0.0 if whole and len(c.effects) == 1 else h.contradiction(u))


def _drift_cost(problem: Problem, fit: Fit, drift: Drift) -> float:
    """What a drift of the gain that was fitted costs beside what the periods say of it; 0 without one."""
    at = [i for i, c in enumerate(fit.hypothesis.coordinates) if c.effect == DRIFTING]
    if not at or not np.isfinite(fit.cost):
        return 0.0
    effects = fit.hypothesis.point(fit.u).effects
    records = (part.record for part in problem.parts if isinstance(part.record, Record))
    rate = float(np.mean([trend(record, effects) for record in records]))
    share = rate / effects[DRIFTING]["rate"] if rate else 1.0
    sd = 0.0 if fit.jacobian is None else fit.spread[at[0]] * fit.hypothesis.coordinates[at[0]].scale
    return drift.against(rate, float(share * sd))


def idle_cost(point: Point, names: Sequence[str], rig: Rig) -> float:
    """Cost of those of the named effects that change nothing at a point of a rig; inf where others are named with them.

    What then explains is a stated constant that moved beside them, and any other error of the time between two channels
    may do the same. An effect alone is still the nearest name for that. Beside another one it is a name too many: it
    would pass for a part of the cause while what its constant makes up for is a lack of the other effect.
    """
    idle = sum(_later(point, name, names, rig) <= 0 if name in REPLACED else _absent(point, name) for name in names)
    return inf if idle and len(names) > 1 else IDLE * idle


def unnamed_pair(attribution: Attribution) -> Candidate | None:
    """The best pair that is not named because one of both only replaces what is stated, as a lag in another form does,
    see `idle_cost`; None without one."""
    p = attribution.problem
    rig, reached = p.parts[0].record.nominal, (motion_reached(p), current_reached(p))
    found = [
        c for c in attribution.candidates
        if len(c.effects) > 1 and not c.contradicted and np.isfinite(c.fit.cost)
        and not any(_absent(c.fit.hypothesis.point(c.fit.u), name) for name in c.effects)
        and isinf(idle_cost(c.fit.hypothesis.point(c.fit.u), c.effects, rig))
        and np.isfinite(meaningless_cost(c.fit, rig, *reached))
    ]  # fmt: skip
    return min(found, key=lambda c: c.predictive, default=None)


def _absent(point: Point, name: str) -> bool:
    """Whether an effect changes nothing: its size does not, nor is any knee that it may have instead within reach."""
    places = (key for key, parameter in EFFECTS[name].parameters.items() if isinf(parameter.absent))
    at = point.effects.get(name, {})
    unreached = all(isinf(at.get(key, inf)) for key in places)
    return unreached and effect_value(point.effects, name) == effect_value({}, name)


def _later(point: Point, name: str, names: Sequence[str], rig: Rig) -> float:
    """By how much (s) a block with a named lag is later than stated, beyond SAME of what the effect adds.

    A block whose stated time constant grew does lag, in one pole instead of two. One whose time constant fell by what
    the effect adds does not: both are one lag in another form.
    """
    stated = REPLACED[name]
    grown = getattr(rig, stated) * point.changes.get(stated, 0.0)
    return (1 - SAME) * added_lag(point.effects, name, names, rig.effects) + grown
