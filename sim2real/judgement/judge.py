"""Which hypothesis to believe: probabilities of none, calibration, effects, pairs and unknown, and the verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from maglev_env.loop.effect import EFFECTS, effect_value
from sim2real.compared.problem import KINDS
from sim2real.compared.simulated import Point
from sim2real.judgement.dispersion import NOISE_ALONE, NOISE_INFLATION, Dispersion, dispersion_of
from sim2real.judgement.drift import DRIFT
from sim2real.judgement.lost_commands import LOST, scatter_cost
from sim2real.judgement.unsynchronised import FOREIGN, LOUD
from sim2real.search.attribute import Attribution
from sim2real.search.fitting import Fit
from sim2real.search.hypotheses import CALIBRATION, NONE, REPLACED, UNKNOWN, coordinates_of


@dataclass(frozen=True)
class Belief:
    """How evidence becomes probability. The values were tuned on development campaigns, see docs/blind.md.

    Costs differ by a few units where noise decides, and by shares of the whole gap where the form of an effect does. A
    cost that exceeds the best by d therefore counts as freedom ln(1 + d / (freedom + form)): about d when d is small,
    and growing slowly beyond what another form of the same effects leaves unexplained.

    Attributes:
        freedom: Cost difference above which the logarithm bends.
        form_share: Share of the gap that another form may leave; the form_share of each effect's card adds its share
            of what that effect saves.
        prior_singles: Prior odds of all single effects together, against calibration.
        prior_pairs: Prior odds of all pairs together.
        prior_none: Prior odds of the untouched nominal rig.
        leftover: Multiple of its form share that an effect may leave of a single group's gap.
        group_sd: Standard deviations beyond the noise that a free correction of a group must explain.
        group_cost: Cost of such a correction.
        unknown_cost: Log odds against an unknown cause where no group is left unexplained.
        parameter_cost: Cost of each parameter of an effect beyond its first, which noise alone lets it save.
        search_cost: The same for searching a frequency.
        form_cost: Penalty on a form that may leave more than WIDE_FORM of the gap, per factor e, because it predicts
            every cost less sharply.
    """

    freedom: float = 30.0
    form_share: float = 0.0005
    prior_singles: float = 0.4
    prior_pairs: float = 0.02
    prior_none: float = 0.3
    leftover: float = 3.0
    group_sd: float = 4.5
    group_cost: float = 30.0
    unknown_cost: float = 2.6
    parameter_cost: float = 4.0
    search_cost: float = 10.0
    form_cost: float = 1.0


BELIEF = Belief()
WIDE_FORM = 0.01
CLASS_SHARE = 0.15  # hypotheses with at least this share of the best one's probability are not distinguished from it
STRAINED = 3.0  # tolerances from which a stated parameter that moved counts as it is, whatever the form of an effect is
IDLE = 25.0  # cost that an effect must save to be named although it ended where it changes nothing
SIGNIFICANT = 5.0  # standard deviations of a group's excess
OPEN = (FOREIGN, LOUD, DRIFT)  # families of what varies over the periods that need not have a known cause


@dataclass(frozen=True)
class Evidence:
    """What probabilities are computed from.

    Groups are residuals of the same output, kind of line and octave.

    Attributes:
        effects: Effects of each candidate, calibration first.
        cost: Predictive cost of each candidate; inf where it touches down, or contradicts a stated tolerance.
        nominal: Cost of the untouched nominal rig.
        excess: Cost of each group beyond the noise, (candidates, G).
        scatter: Scatter (G,) of that cost under noise alone.
        groups: Output, kind and octave (Hz) of each group.
        tones: Chi-square of each family of tones that was found.
        spin: Cost of each effect that may explain what turns with the rotor.
        causes: Cost of each effect that may explain one of the OPEN families.
        dispersion: What the best candidate leaves beyond noise.
        strain: Part of each candidate's cost that stated parameters make that moved by more than STRAINED tolerances.
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


@dataclass(frozen=True)
class Entry:
    """One hypothesis.

    Attributes:
        effects: Its effects, or ("none",), ("calibration",) or ("unknown",).
        probability: Its probability.
        cost: Its cost.
        candidate: Index of its fit; None where there is none.
        explained_worst_group: Smallest share that it explains of any significant group's gap; None without such a
            group.
    """

    effects: tuple[str, ...]
    probability: float
    cost: float
    candidate: int | None
    explained_worst_group: float | None


def evidence_of(
    attribution: Attribution,
    tones: Mapping[str, float],
    spin: Mapping[str, float],
    causes: Mapping[str, Mapping[str, float]],
) -> Evidence:
    """The evidence of fitted candidates, of tones (see `unsynchronised`) and of trends (see `drift`)."""
    p = attribution.problem
    octave = np.floor(np.log2(np.maximum(p.frequency, 1e-9))).astype(int)
    rows = np.stack([p.output, p.kind, octave], axis=1)
    names, label, count = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    label = label.reshape(-1)
    residuals = [c.fit.residual for c in attribution.candidates]
    points = [c.fit.hypothesis.point(c.fit.u) for c in attribution.candidates]
    cost = np.array([
        np.inf if c.contradicted else c.predictive + scatter_cost(p, point) + idle_cost(point, c.effects)
        for c, point in zip(attribution.candidates, points, strict=True)
    ])  # fmt: skip
    if not np.isfinite(
        attribution.calibration.fit.cost
    ):  # no rotor levitates without an effect: use the gap of the opened nominal loop
        residuals[0] = p.opened_residual()
    best = attribution.candidates[int(np.argmin(cost))].fit
    excess = [np.bincount(label, abs(r) ** 2, count.size) - 2.0 * count for r in residuals]
    return Evidence(
        tuple(c.effects for c in attribution.candidates),
        cost,
        attribution.nominal,
        np.array(excess),
        NOISE_INFLATION * np.sqrt(4.0 * count),
        tuple((p.outputs[o], KINDS[k], float(2.0**f)) for o, k, f in names),
        dict(tones),
        dict(spin),
        dict(causes),
        NOISE_ALONE if not np.isfinite(cost.min()) or best.jacobian is None else dispersion_of(p, best),
        np.array([strain_of(c.fit) for c in attribution.candidates]),
    )


def strain_of(fit: Fit) -> float:
    """Cost of stated parameters that moved by more than STRAINED tolerances."""
    first = len(fit.hypothesis.coordinates)
    moved = (fit.prior * np.square(fit.u))[first:]
    stated = [name in fit.hypothesis.tolerances for name in fit.hypothesis.calibrated]
    return float(moved[np.array(stated, bool) & (moved > STRAINED**2)].sum())


def idle_cost(point: Point, names: Sequence[str]) -> float:
    """Cost of those of the named effects that change nothing at a point.

    What then explains is a stated constant that moved beside them, and any other error of the time between two channels
    may do the same. A block whose time constant grew does lag, in one pole instead of two.
    """
    still = (name for name in names if effect_value(point.effects, name) == effect_value({}, name))
    return IDLE * sum(point.changes.get(REPLACED.get(name, ""), 0.0) <= 0 for name in still)


def entries(evidence: Evidence, belief: Belief = BELIEF) -> list[Entry]:
    """All hypotheses with their probabilities, which sum to one; the most probable first."""
    alive = np.isfinite(evidence.cost)
    if not alive.any() and not np.isfinite(evidence.nominal):  # all that levitates contradicts a stated tolerance
        return [Entry((UNKNOWN,), 1.0, np.inf, None, None)]
    best, gap = _best(evidence)
    before = evidence.excess[0]
    forms = _forms(evidence, gap, belief)
    share = min(belief.leftover * forms[best] / gap, 1.0) if gap else 0.0
    allowed = belief.group_sd * evidence.scatter + share * np.maximum(before, 0.0)
    saved = np.maximum(evidence.excess[best] - allowed - belief.group_cost, 0.0).sum()
    singles = max(sum(len(names) == 1 for names in evidence.effects), 1)
    couples = max(singles * (singles - 1) // 2, 1)
    priors = {0: 1.0, 1: belief.prior_singles / singles, 2: belief.prior_pairs / couples}
    rows: list[_Row] = [((NONE,), evidence.nominal, belief.prior_none, None)]
    for i in np.flatnonzero(alive):
        names = evidence.effects[i]
        prior = priors[len(names)] * np.exp(-0.5 * complexity(names, belief))
        rows.append((names or (CALIBRATION,), float(evidence.cost[i]), prior, int(i)))
    if evidence.tones:
        rows = _with_tones(rows, evidence, priors)
    costs = np.array([cost for _, cost, *_ in rows])
    # Another form of an effect leaves data unexplained. It does not make a wrong statement of the rig more likely.
    strain = np.array([0.0 if evidence.strain is None or i is None else evidence.strain[i] for *_, i in rows])
    scale = belief.freedom + np.array([forms[candidate or 0] for *_, candidate in rows])
    # Where the best explanation lacks something, what that does to the costs is taken for evidence: the likelihood is
    # raised to the power of one over the reduced chi-square that is left (a power posterior: P. Grunwald and T. van
    # Ommen, Bayesian Analysis 12, 2017), as standard errors are widened by its root.
    excused = allowance(evidence, belief)
    of_data = costs - strain
    apart = (of_data - of_data.min()) / evidence.dispersion.ratio(excused)
    logs = np.log([prior for *_, prior, _ in rows]) - 0.5 * belief.freedom * np.log1p(apart / scale)
    logs -= 0.5 * strain
    logs -= belief.form_cost * np.log(np.maximum(scale / (belief.freedom + WIDE_FORM * gap), 1.0))
    # The unknown cause is the best hypothesis with a free correction of every group that it leaves unexplained, or of
    # what differs among recordings.
    foreign = _unnamed(rows[int(np.argmin(costs))][0], evidence)
    rows.append(((UNKNOWN,), float(costs.min() - saved - foreign), 1.0, None))
    lacking = max(saved / scale[int(np.argmin(costs))], evidence.dispersion.beyond(excused) / belief.freedom)
    gain = 0.5 * belief.freedom * (np.log1p(lacking) + np.log1p(foreign / belief.freedom)) - belief.unknown_cost
    logs = np.append(logs, logs.max() + gain)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    found = [
        Entry(names, float(w), float(cost), i, _worst(evidence, before, i))
        for (names, cost, _, i), w in zip(rows, weights, strict=True)
    ]
    return sorted(found, key=lambda e: -e.probability)


def _best(evidence: Evidence) -> tuple[int, float]:
    """The candidate of least cost, and what it explains of the gap that calibration leaves."""
    best = int(np.argmin(np.where(np.isfinite(evidence.cost), evidence.cost, np.inf)))
    return best, max(float(evidence.excess[0].sum() - evidence.excess[best].sum()), 0.0)


def allowance(evidence: Evidence, belief: Belief = BELIEF) -> float:
    """Cost that another form of the effects of the best candidate may leave."""
    if not np.isfinite(evidence.cost).any():
        return 0.0
    best, gap = _best(evidence)
    return belief.leftover * float(_forms(evidence, gap, belief)[best])


def _forms(evidence: Evidence, gap: float, belief: Belief) -> np.ndarray:
    """Cost that another form of the effects of each candidate may leave.

    It is a share of what each effect saves beside the candidate's other effects, or of the whole gap where that is not
    known.
    """
    cost = {frozenset(names): c for names, c in zip(evidence.effects, evidence.cost, strict=True)}
    found = np.full(len(evidence.effects), belief.form_share * gap)
    for i, names in enumerate(evidence.effects):
        for name in names:
            others = cost.get(frozenset(names) - {name}, np.inf) if len(names) > 1 else np.inf
            saved = np.clip(others - evidence.cost[i], 0.0, gap) if np.isfinite(evidence.cost[i]) else 0.0
            found[i] += (EFFECTS[name].form_share if name in EFFECTS else 0.0) * saved
    return found


_Row = tuple[tuple[str, ...], float, float, int | None]


def _with_tones(rows: list[_Row], evidence: Evidence, priors: Mapping[int, float]) -> list[_Row]:
    """The hypotheses with and without tones as causes.

    Without them a hypothesis costs what the tones weigh. Calibration and single effects may have them explained; those
    of an OPEN family without a known cause only the unknown one explains.
    """
    found: dict[tuple[str, ...], _Row] = {}

    def propose(row: _Row) -> None:
        """Of rows with the same names the best counts."""
        key = tuple(sorted(row[0]))
        if key not in found or row[1] < found[key][1]:
            found[key] = row

    quiet = {family: weight for family, weight in evidence.tones.items() if family != LOUD}
    of_tones, without_bands = _named(evidence.tones, evidence), _named(quiet, evidence)
    for names, cost, prior, candidate in rows:
        base = () if candidate is None else evidence.effects[candidate]
        tones, named = (quiet, without_bands) if LOST in base else (evidence.tones, of_tones)
        propose((names, cost + sum(tones.values()), prior, candidate))
        for added, off in named:
            both = _joined(base, added)
            if candidate is not None and added and len(both) <= 2:
                propose((both, cost + off, prior * priors[len(both)] / priors[len(base)], candidate))
    return list(found.values())


def _named(tones: Mapping[str, float], evidence: Evidence) -> list[tuple[tuple[str, ...], float]]:
    """The effects that may explain tones, and what they cost together with the tones that they leave."""
    named: list[tuple[tuple[str, ...], float]] = [((), 0.0)]
    if "pickup" in tones:
        named = [((*names, "pickup"), cost) for names, cost in named]
    if "spin" in tones:
        named = [((*names, effect), cost + off) for names, cost in named for effect, off in evidence.spin.items()]
    for family in (f for f in OPEN if f in tones):
        causes = evidence.causes.get(family, {}).items()
        named = [(names, cost + tones[family]) for names, cost in named] + [
            (names if effect in names else (*names, effect), cost + off)
            for names, cost in named
            for effect, off in causes
        ]
    return named


def _joined(base: tuple[str, ...], added: tuple[str, ...]) -> tuple[str, ...]:
    """Fitted effects and those of tones: a gain that drifts may also be another one in the mean."""
    kept = (name for name in base if name != "actuator_gain" or "gain_drift" not in added)
    return (*kept, *added)


def _unnamed(names: tuple[str, ...], evidence: Evidence) -> float:
    """What these effects leave of what the OPEN families weigh."""
    left = 0.0
    for family in (f for f in OPEN if f in evidence.tones):
        causes = {**evidence.causes.get(family, {}), **({LOST: 0.0} if family == LOUD else {})}
        left += min([evidence.tones[family], *(off for effect, off in causes.items() if effect in names)])
    return left


def complexity(names: tuple[str, ...], belief: Belief) -> float:
    """Cost of the freedom that effects have beyond one parameter each.

    The parameters of an effect that is like another one while the motion is small count as one: there, they are.
    """
    found = 0.0
    for name in names:
        if name in EFFECTS and EFFECTS[name].linear_as:
            continue
        parameters = [c.parameter for c in coordinates_of(name)]
        found += belief.parameter_cost * max(len(parameters) - 1, 0) + belief.search_cost * ("frequency" in parameters)
    return found


def _worst(evidence: Evidence, before: np.ndarray, candidate: int | None) -> float | None:
    """Smallest share of a significant group's gap beyond calibration that a candidate explains."""
    if not candidate:
        return None
    significant = before > SIGNIFICANT * evidence.scatter
    if not significant.any():
        return None
    left = np.maximum(evidence.excess[candidate][significant] - 3.0 * evidence.scatter[significant], 0.0)
    return float(np.min(1.0 - left / before[significant]))


def with_effects(found: Sequence[Entry]) -> list[Entry]:
    """The hypotheses that name effects."""
    return [e for e in found if e.effects[0] not in (NONE, CALIBRATION, UNKNOWN)]


def verdict(found: Sequence[Entry]) -> tuple[str, tuple[str, ...]]:
    """The verdict and the cause; in a class of alternatives a pair is written "a+b".

    Returns:
        verdict: "no_gap", "explained", "ambiguous" or "unexplained".
        cause: Names of the effects.
    """
    mass = {kind: sum(e.probability for e in found if e.effects == (kind,)) for kind in (NONE, CALIBRATION, UNKNOWN)}
    named = with_effects(found)
    effects = sum(e.probability for e in named)
    if mass[NONE] + mass[CALIBRATION] >= max(effects, mass[UNKNOWN]):
        return "no_gap", ()
    if mass[UNKNOWN] >= effects or not named:
        return "unexplained", (UNKNOWN,)
    return worded(alternatives(named))


def alternatives(named: Sequence[Entry]) -> list[Entry]:
    """Of hypotheses with effects, the most probable first, those that are not distinguished from the first."""
    alike: list[Entry] = []
    for e in named:
        more = any(set(e.effects) > set(other.effects) for other in alike)  # the same effects and a superfluous one
        if e.probability >= CLASS_SHARE * named[0].probability and not more:
            alike.append(e)
    return alike


def worded(alike: Sequence[Entry]) -> tuple[str, tuple[str, ...]]:
    """The verdict and the cause, as of `verdict`, of hypotheses that are not distinguished."""
    if len(alike) == 1:
        return "explained", alike[0].effects
    return "ambiguous", tuple("+".join(e.effects) for e in alike)
