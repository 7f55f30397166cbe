"""Learning a judge: constants of belief by the likelihood of the truth, then trust, sets and leftovers by counting."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import ceil, inf, isfinite

import numpy as np
from scipy.optimize import minimize, minimize_scalar
from scipy.special import logit

from sim2real.blind.cases import NO_GAP, named
from sim2real.blind.judging.calibration import calibration_error
from sim2real.blind.judging.judging import ranked
from sim2real.blind.learning.examples import Example
from sim2real.judgement.belief import LEVEL, NO_SET, Belief, Judge, channels_of
from sim2real.judgement.judge import lacking
from sim2real.judgement.likely import fewest

# Each constant that is learned is known to a factor: standard deviation of its natural logarithm. The others say what
# they mean (form_share, leftover and group_sd go with the cards of effects).
KNOWN = 0.7
LEARNED = (
    "freedom", "prior_singles", "prior_pairs", "prior_none", "group_cost", "unknown_cost", "unknown_alike",
    "parameter_cost", "search_cost", "form_cost",
)  # fmt: skip
LEAST = 1e-3  # probability that counts where the truth was given less: it may not have been fitted at all
ROUNDS = 250  # evaluations of the likelihood, at most
TRUSTED = (0.2, 1.5)  # range of the trust
FOLDS = 4
SURE = 0.95  # probability from which on a judge is nearly certain
UNKNOWN = frozenset({"unknown"})


@dataclass(frozen=True)
class Learned:
    """A judge, and what it is worth on families that it did not learn from, beside the judge without learning.

    Attributes:
        judge: Learned from all examples. Its belief is that of the code where a learned one is no better.
        score: Mean logarithm of the truth's probability, on families left out; and that without learning.
        error: Calibration error likewise.
        size: Median number of hypotheses in a set that holds the truth in LEVEL of campaigns, likewise; all count where
            no set does.
    """

    judge: Judge
    score: tuple[float, float]
    error: tuple[float, float]
    size: float


def learn(examples: Sequence[Example], before: Judge, progress: Callable[[str], None] = lambda text: None) -> Learned:
    """Learn a judge, and validate it on families of truths that are left out in turn.

    What a set must reach is told on those, too: on what taught it, a judge is too sure.

    Args:
        examples: To learn from.
        before: The judge whose constants are the prior.
        progress: Called with the name of each step.

    Raises:
        ValueError: There are too few families to leave some out.
    """
    families = sorted({e.family for e in examples})
    if len(families) < FOLDS:
        raise ValueError(f"examples of {len(families)} families of truths: {FOLDS} are needed to leave some out")
    folds = [set(families[fold::FOLDS]) for fold in range(FOLDS)]
    scores = {}
    for free in (True, False):
        told: list[tuple[float, float, float]] = []
        masses: list[tuple[str, float]] = []
        lists: list[list[float]] = []
        for n, out in enumerate(folds, 1):
            progress(f"families left out: {n} of {FOLDS}, {'belief and trust' if free else 'trust'}")
            judge = judge_of([e for e in examples if e.family not in out], before, free)
            for e in (e for e in examples if e.family in out):
                told.append(_told(e, judge))
                masses.append((channels_of(e.evidence), _mass_before_truth(e, judge)))
                lists.append([entry.probability for entry in e.found(judge)])
        scores[free] = np.array(told), masses, lists
    free = bool(scores[True][0][:, 2].mean() > scores[False][0][:, 2].mean())
    ours, masses, lists = scores[free]
    reached = {name: _reached([m for c, m in masses if c == name]) for name in sorted({c for c, _ in masses})}
    progress("all families")
    judge = replace(judge_of(examples, before, free), reached=reached)
    theirs = np.array([_told(e, before) for e in examples])
    sizes = [fewest(p, reached[c]) for (c, _), p in zip(masses, lists, strict=True)]
    return Learned(
        judge,
        (float(ours[:, 2].mean()), float(theirs[:, 2].mean())),
        (calibration_error(ours[:, :2]), calibration_error(theirs[:, :2])),
        float(np.median(sizes)),
    )


def judge_of(examples: Sequence[Example], before: Judge, free: bool = True) -> Judge:
    """The judge that examples teach; the same examples give the same bits.

    Args:
        examples: To learn from.
        before: The judge whose constants are the prior.
        free: Whether the constants of its belief are learned, too.
    """
    judge = replace(before, trust={}, reached={}, left={}, surest=1.0, right=Judge().right)
    if free:
        judge = _with_belief(examples, judge)
    judge = replace(judge, trust=_by_channels(examples, lambda own, name: _trust(own, judge, name)))
    left = _by_channels(examples, lambda own, name: _left(own, judge))
    judge = replace(judge, left=left, surest=_surest(examples, judge))
    return replace(judge, right=_right(examples, judge))


def _with_belief(examples: Sequence[Example], plain: Judge) -> Judge:
    """The judge with the constants of belief under which the truths are the most likely, within what was KNOWN."""
    start = np.log([getattr(plain.belief, name) for name in LEARNED])

    def at(moved: np.ndarray) -> Judge:
        values = dict(zip(LEARNED, map(float, np.exp(start + moved)), strict=True))
        return replace(plain, belief=Belief(**{**asdict(plain.belief), **values}))

    def cost(moved: np.ndarray) -> float:
        return -log_score(examples, at(moved)) + 0.5 * float(moved @ moved) / KNOWN**2

    first = np.vstack([np.zeros(len(LEARNED)), 0.4 * np.eye(len(LEARNED))])
    options = {"maxfev": ROUNDS, "initial_simplex": first, "xatol": 1e-3, "fatol": 1e-2}
    return at(minimize(cost, np.zeros(len(LEARNED)), method="Nelder-Mead", options=options).x)


def log_score(examples: Sequence[Example], judge: Judge) -> float:
    """Sum of the logarithms of the truths' probabilities."""
    return float(sum(np.log(max(e.probability(judge), LEAST)) for e in examples))


def _by_channels(examples: Sequence[Example], of: Callable) -> Mapping:
    names = sorted({channels_of(e.evidence) for e in examples})
    return {name: of([e for e in examples if channels_of(e.evidence) == name], name) for name in names}


def _trust(examples: Sequence[Example], judge: Judge, channels: str) -> float:
    """The exponent of probabilities under which the truths are the most likely."""
    low, high = np.log(TRUSTED)

    def cost(logarithm: float) -> float:
        return -log_score(examples, replace(judge, trust={channels: float(np.exp(logarithm))}))

    return float(np.exp(minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-3}).x))


def _reached(masses: Sequence[float]) -> float:
    """The mass that sets must exceed so that they hold the truth of a further campaign at LEVEL, from the masses before
    the truth in campaigns that a judge did not learn from; NO_SET where these are few, or too many lack the truth."""
    rank = ceil((len(masses) + 1) * LEVEL)
    return min(float(sorted(masses)[rank - 1]), NO_SET) if rank <= len(masses) else NO_SET


def _left(examples: Sequence[Example], judge: Judge) -> tuple[float, ...]:
    """What is left of known causes, in ascending order."""
    left = (lacking(e.evidence, judge) for e in examples if e.truth != UNKNOWN)
    return tuple(sorted(amount for amount in left if isfinite(amount)))


def _surest(examples: Sequence[Example], judge: Judge) -> float:
    """How probable an unknown cause is where a judge is nearly certain of it, by Laplace's rule of succession."""
    sure = [e for e in examples if any(named(h.effects) == UNKNOWN and h.probability > SURE for h in e.found(judge))]
    return (sum(e.truth == UNKNOWN for e in sure) + 1) / (len(sure) + 2)


def _right(examples: Sequence[Example], judge: Judge) -> tuple[float, float]:
    """How often the most probable hypothesis was right."""
    return rightness([_first(e, judge) for e in examples])


def rightness(firsts: Sequence[tuple[frozenset[str], float, bool]]) -> tuple[float, float]:
    """`Judge.right` by the most probable hypotheses of campaigns: (effects, probability, whether it was right).

    The constants under which what was right is the most likely; a is 0 to one and b 1 to a half, standard deviations.
    """
    told = np.array([(p, right) for effects, p, right in firsts if effects != NO_GAP], float).reshape(-1, 2)
    x, sign = logit(np.clip(told[:, 0], LEAST, 1 - LEAST)), np.where(told[:, 1] > 0, -1.0, 1.0)

    def cost(v: np.ndarray) -> float:
        return float(np.logaddexp(0, sign * (v[0] + v[1] * x)).sum() + 0.5 * v[0] ** 2 + 2 * (v[1] - 1) ** 2)

    a, b = minimize(cost, [0.0, 1.0], method="BFGS").x
    return float(a), float(max(b, 0.0))


def _first(e: Example, judge: Judge) -> tuple[frozenset[str], float, bool]:
    """The most probable hypothesis, its probability, and whether it is the truth; as scored."""
    first, probability = ranked((entry.effects, entry.probability) for entry in e.found(judge))[0]
    return first, probability, first == e.truth


def _mass_before_truth(e: Example, judge: Judge) -> float:
    """Probability of all hypotheses that are more probable than the truth; inf where it is not among them."""
    before = 0.0
    for entry in e.found(judge):
        if named(entry.effects) == e.truth:
            return before
        before += entry.probability
    return inf


def _told(e: Example, judge: Judge) -> tuple[float, float, float]:
    """Probability of the first hypothesis, whether it is the truth, and the logarithm of the truth's probability.

    As scored: "none" and "calibration" are one hypothesis.
    """
    _, probability, right = _first(e, judge)
    return probability, float(right), float(np.log(max(e.probability(judge), LEAST)))
