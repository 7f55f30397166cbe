"""Which hypothesis to believe: probabilities of none, calibration, effects, pairs and unknown, and the verdict."""

from dataclasses import dataclass
from math import inf, isfinite

import numpy as np

from maglev_env.loop.effect import EFFECTS
from sim2real.judgement.belief import Belief, Judge, channels_of, shipped
from sim2real.judgement.evidence import Evidence
from sim2real.judgement.tones.rows_with_tones import Row, left_of_known, tones_of, unnamed, with_tones
from sim2real.search.hypotheses import CALIBRATION, NONE, UNKNOWN, coordinates_of

WIDE_FORM = 0.01
SIGNIFICANT = 5.0  # standard deviations of a group's excess
SURELY_BEHIND = 60.0  # cost behind a pair without a residue from which on another form is hardly believed
BY_CHANCE = 0.001  # the same as a share of the gap
FAR_BEHIND = 10.0  # the same in standard deviations of the noise, however large the gap is
BESIDE_WHOLE = 0.05  # share of what another form may leave, or of what it leaves, that is then still believed
SURELY = 12.0  # cost that an effect must save beyond all named ones to show something although it has no meaning
HOPELESS = 1e4  # ratio of probabilities from which on the smaller one does not matter


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


def entries(evidence: Evidence, judge: Judge | None = None) -> list[Entry]:
    """All hypotheses with their probabilities, which sum to one; the most probable first.

    Args:
        evidence: What they are computed from.
        judge: By default the shipped one.
    """
    judge = judge or shipped()
    belief = judge.belief
    alive = np.isfinite(evidence.cost)
    if not alive.any() and not np.isfinite(evidence.nominal):  # all that levitates contradicts a stated tolerance
        return [Entry((UNKNOWN,), 1.0, np.inf, None, None)]
    best, gap = _best(evidence)
    before = evidence.excess[0]
    forms = _forms(evidence, gap, belief)
    saved = _saved_by_correction(evidence, best, gap, forms, belief)
    singles = max(sum(len(names) == 1 for names in evidence.effects), 1)
    couples = max(singles * (singles - 1) // 2, 1)
    priors = {0: 1.0, 1: belief.prior_singles / singles, 2: belief.prior_pairs / couples}
    priors[3] = priors[2] ** 2 / priors[1]  # a pair beside a tone
    rows: list[Row] = [((NONE,), evidence.nominal, belief.prior_none, None)]
    for i in np.flatnonzero(alive):
        names = evidence.effects[i]
        prior = priors[len(names)] * np.exp(-0.5 * _complexity_of(evidence, int(i), belief))
        rows.append((names or (CALIBRATION,), float(evidence.cost[i]), prior, int(i)))
    if evidence.tones:
        rows = with_tones(rows, evidence, priors)
    costs = np.array([cost for _, cost, *_ in rows])
    # Another form of an effect leaves data unexplained. It does not make a wrong statement of the rig more likely.
    strain = np.array([0.0 if evidence.strain is None or i is None else evidence.strain[i] for *_, i in rows])
    scale = belief.freedom + np.array([forms[candidate or 0] for *_, candidate in rows])
    # Where the best explanation lacks something, what that does to the costs is taken for evidence: the likelihood is
    # raised to the power of one over the reduced chi-square that is left (a power posterior: P. Grunwald and T. van
    # Ommen, Bayesian Analysis 12, 2017), as standard errors are widened by its root.
    excused = _excused(forms, best, belief)
    of_data = costs - strain
    # What the mains and the rotation make on lines of their own is no matter of form.
    of_tones = np.array([left_of_known(names, evidence) for names, *_ in rows])
    nearest = int(np.argmin(of_data))
    beside = of_tones - of_tones[nearest]
    apart = (of_data - of_data[nearest] - beside) / scale + beside / belief.freedom
    likelihood = -0.5 * belief.freedom * np.log1p(np.maximum(apart, 0.0) / evidence.dispersion.ratio(excused))
    likelihood -= belief.form_cost * np.log(np.maximum(scale / (belief.freedom + WIDE_FORM * gap), 1.0))
    logs = np.log([prior for *_, prior, _ in rows]) + _as_excused(likelihood, of_data, scale, strain) - 0.5 * strain
    # The unknown cause is the best hypothesis with a free correction of every group that it leaves unexplained, or of
    # what differs among recordings.
    named_best, *_, at_best = rows[int(np.argmin(costs))]
    foreign = unnamed(named_best, at_best, evidence)
    rows.append(((UNKNOWN,), float(costs.min() - saved - foreign), 1.0, None))
    unlike = _unlike(evidence, saved, forms[best], excused, belief)
    gain = 0.5 * belief.freedom * (np.log1p(unlike) + np.log1p(foreign / belief.freedom))
    against = np.array([_against_unknown(names, belief) for names, *_ in rows[:-1]])
    # An unknown cause may do what a hypothesis does only with parameters far outside their stated tolerances. Its
    # penalty then grows with the logarithm of the strain, and its prior is at most that of one single effect.
    bent = logs + 0.5 * strain - 0.5 * belief.freedom * np.log1p(strain / belief.freedom)
    bent -= [max(np.log(prior / priors[1]), 0.0) for _, _, prior, _ in rows[:-1]]
    meant = _meant_by_none(evidence, of_data.min(), priors[1], excused, belief)
    logs = np.append(logs, max((logs - against).max() + gain, (bent - against).max(), meant))
    weights = np.exp(judge.trust.get(channels_of(evidence), 1.0) * (logs - logs.max()))
    weights /= weights.sum()
    if (known := weights[:-1].sum()) < 1 / HOPELESS:
        # An unknown cause leaves none of them probable, and bends what the rig states. By the likelihood an effect may
        # come first that explains hardly anything, before one that explains nearly all and takes up the rest so.
        weights[:-1] = known * np.exp(bent - np.logaddexp.reduce(bent))
    found = [
        Entry(names, float(w), float(cost), i, _worst(evidence, before, i))
        for (names, cost, _, i), w in zip(rows, weights, strict=True)
    ]
    return sorted(found, key=lambda e: (-e.probability, e.cost))


def lacking(evidence: Evidence, judge: Judge | None = None) -> float:
    """What the best candidate leaves beyond noise and beyond what its form may leave, in units of what a form may; 0
    where it leaves nothing. It speaks for an unknown cause."""
    judge = judge or shipped()
    if not np.isfinite(evidence.cost).any():
        return np.inf
    best, gap = _best(evidence)
    forms = _forms(evidence, gap, judge.belief)
    saved = _saved_by_correction(evidence, best, gap, forms, judge.belief)
    return _unlike(evidence, saved, forms[best], _excused(forms, best, judge.belief), judge.belief)


def _saved_by_correction(evidence: Evidence, best: int, gap: float, forms: np.ndarray, belief: Belief) -> float:
    """What a free correction of every group would save that the best candidate leaves unexplained; or one of a stated
    constant, where that has no name beside the effects that it helps."""
    whole = max(float(evidence.excess[0].sum() - evidence.excess[best].sum()), gap)
    share = min(belief.leftover * forms[best] / whole, 1.0) if whole else 0.0
    allowed = belief.group_sd * evidence.scatter + share * np.maximum(evidence.excess[0], 0.0)
    of_groups = float(np.maximum(evidence.excess[best] - allowed - belief.group_cost, 0.0).sum())
    return max(of_groups, float(evidence.cost[best]) - evidence.nameless - belief.group_cost)


def _as_excused(likelihood: np.ndarray, cost: np.ndarray, scale: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """Logarithms of likelihoods (n,), none of them below that of a hypothesis that explains less and is excused more.

    What a form leaves is excused because real ones differ. Where an effect without another form explains more than one
    that is excused, that excuse would otherwise name the worse of both: a lag of any form for a plain delay. What
    contradicts the rig is not named whatever it is excused, by as much as it strains that more than the better one.

    Args:
        likelihood: Logarithms.
        cost: Costs.
        scale: What is excused, of each.
        strain: Part of the cost that contradicts the rig, which `cost` is without.
    """
    worse = (cost >= cost[:, None]) & (scale >= scale[:, None])
    named = likelihood - 0.5 * np.maximum(strain - strain[:, None], 0.0)
    return np.max(np.where(worse, named, -np.inf), axis=1)


def _against_unknown(names: tuple[str, ...], belief: Belief) -> float:
    """Log odds against an unknown cause where these effects leave nothing that is significant."""
    describes = any(name in EFFECTS and EFFECTS[name].describes for name in names)
    return belief.unknown_alike if describes else belief.unknown_cost


def _unlike(evidence: Evidence, saved: float, form: float, excused: float, belief: Belief) -> float:
    return max(saved / (belief.freedom + form), evidence.dispersion.beyond(excused) / belief.freedom)


def _meant_by_none(evidence: Evidence, least: float, prior: float, excused: float, belief: Belief) -> float:
    """Logarithm of the weight of what only one effect explains alone, at parameters at which it has no meaning.

    A pair of names may do as well, each of which makes up for a part of it. One unknown cause is then as simple as one
    known cause is. Where a name alone does as well, it is that. Where calibration leaves no more than noise does on
    average, nothing is to be explained: a form without a meaning has a freedom, in ranges that mean nothing either, of
    which its number of parameters says too little.

    Args:
        evidence: What is weighed.
        least: Cost of the best hypothesis.
        prior: Prior odds of a single effect.
        excused: As `allowance` says.
        belief: The constants.
    """
    if evidence.refused is None or not np.isfinite(evidence.refused).any() or not evidence.excess[0].sum() > 0:
        return -np.inf
    at = int(np.argmin(evidence.refused))
    alone = [cost for names, cost in zip(evidence.effects, evidence.cost, strict=True) if len(names) < 2]
    if not evidence.refused[at] < min(alone) - SURELY:
        return -np.inf
    tones = sum(tones_of(evidence, ()).values())
    apart = max(evidence.refused[at] + tones - least, 0.0) / evidence.dispersion.ratio(excused)
    freedom = 0.5 * belief.freedom * np.log1p(apart / belief.freedom)
    return float(np.log(prior) - 0.5 * _complexity_of(evidence, at, belief) - freedom)


def _best(evidence: Evidence) -> tuple[int, float]:
    """The candidate of least cost, and what it explains of what calibration leaves, at most as much as the motion."""
    best = int(np.argmin(np.where(np.isfinite(evidence.cost), evidence.cost, np.inf)))
    explained = float(evidence.excess[0].sum() - evidence.excess[best].sum())
    return best, min(max(explained, 0.0), max(evidence.motion, 0.0))


def allowance(evidence: Evidence, judge: Judge | None = None) -> float:
    """Cost that another form of the effects of the best candidate may leave."""
    belief = (judge or shipped()).belief
    if not np.isfinite(evidence.cost).any():
        return 0.0
    best, gap = _best(evidence)
    return _excused(_forms(evidence, gap, belief), best, belief)


def _excused(forms: np.ndarray, best: int, belief: Belief) -> float:
    """The same by what `_forms` found."""
    return belief.leftover * float(forms[best])


def reach(evidence: Evidence, judge: Judge | None = None) -> np.ndarray:
    """Cost above the best (candidates,) from which on each is less probable than it by a factor HOPELESS.

    By the same scales and the same tempering as in `entries`.
    """
    judge = judge or shipped()
    if not np.isfinite(evidence.cost).any():
        return np.full(len(evidence.effects), np.inf)
    belief = judge.belief
    scale = belief.freedom + _forms(evidence, _best(evidence)[1], belief)
    logarithm = np.log(HOPELESS) / judge.trust.get(channels_of(evidence), 1.0)
    bent = np.expm1(2 * logarithm / belief.freedom) * scale
    return bent * evidence.dispersion.ratio(allowance(evidence, judge))


def _forms(evidence: Evidence, gap: float, belief: Belief) -> np.ndarray:
    """Cost that another form of the effects of each candidate may leave.

    It is a share of what each effect saves beside the candidate's other effects, or of the whole gap where that is not
    known; less, where a pair leaves nothing (`_behind_a_whole_pair`). Of two that may stand for each other either saves
    little beside the other; of what both save, the smaller of their shares remains in any case. Nothing is excused more
    than it explains.
    """
    costs = evidence.cost.tolist()  # plain numbers: candidates are many, and their effects one or two
    cost = {frozenset(names): c for names, c in zip(evidence.effects, costs, strict=True)}
    found = np.full(len(evidence.effects), belief.form_share * gap)
    for i, names in enumerate(evidence.effects):
        if not names or not isfinite(costs[i]):
            continue
        shares = [EFFECTS[name].form_share if name in EFFECTS else 0.0 for name in names]
        others = [cost.get(frozenset(names) - {name}, inf) if len(names) > 1 else inf for name in names]
        saved = [min(max(other - costs[i], 0.0), gap) for other in others]
        explained = min(max(costs[0] - costs[i], 0.0), gap)
        found[i] += min(max(float(np.dot(shares, saved)), min(shares) * explained), explained)
    behind = _behind_a_whole_pair(evidence, gap)
    return np.where(behind > 0, BESIDE_WHOLE * np.minimum(found, behind), found)


def _behind_a_whole_pair(evidence: Evidence, gap: float) -> np.ndarray:
    """How much more each candidate leaves (candidates,) than a pair that leaves nothing but noise; 0 where that is not
    sure.

    Another form leaves what no other effect has. Where a second effect takes all of it away, down to the noise of every
    recording, it was hardly a matter of form: a stop that explains nearly the whole motion would otherwise hide a lag
    beside it, which is small against what a form of the stop may leave. What is below a small share of the whole gap
    any effect may happen to take away, but hardly what stands far out of the noise, down to the noise.
    """
    noise = float(np.sqrt((evidence.scatter**2).sum()))
    whole = [
        cost for names, cost, excess in zip(evidence.effects, evidence.cost, evidence.excess, strict=True)
        if len(names) == 2 and isfinite(cost) and excess.sum() <= 2.0 * noise
    ]  # fmt: skip
    if not whole:
        return np.zeros(evidence.cost.shape)
    behind = evidence.cost - min(whole)
    return np.where(behind > max(SURELY_BEHIND, min(BY_CHANCE * gap, FAR_BEHIND * noise)), behind, 0.0)


def _complexity_of(evidence: Evidence, candidate: int, belief: Belief) -> float:
    """Cost of the freedom of a candidate's effects, without that of parameters which are not told from their ends."""
    untold = 0.0 if evidence.at_end is None else float(evidence.at_end[candidate])
    return complexity(evidence.effects[candidate], belief) - belief.parameter_cost * untold


def complexity(names: tuple[str, ...], belief: Belief) -> float:
    """Cost of the freedom that effects have beyond one parameter each.

    The parameters of an effect that is like another one while the motion is small count as one: there, they are.
    """
    found = 0.0
    for name in names:
        if name in EFFECTS and EFFECTS[name].like:
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
