"""One answer judged against the truth in every respect. A failed answer is wrong in all of them."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from math import inf

from maglev_env.loop.effect import EFFECTS
from sim2real.blind.cases import Answer, Case, named
from sim2real.blind.judging.alike import alike_sets
from sim2real.judgement.belief import LEVEL
from sim2real.judgement.likely import fewest


@dataclass(frozen=True)
class Judgement:
    """How an answer compares with the truth.

    Attributes:
        case: The case.
        answer: The answer.
        false_alarm: The verdict is not no_gap.
        right_class: The truth is in the cause, and every other member of an ambiguous cause is alike to it on these
            channels.
        class_size: Number of members of the cause that holds the truth; 0 when it does not.
        alone: The truth is the only member.
        abstained: Ambiguous with the truth among others, or unexplained, or no_gap below the detection threshold.
        right_block: See `right_block`.
        one_named: The truth shares an effect, or one that is alike, with every member of the cause, and with some
            member by name.
        second: A pair was named.
        flagged: The verdict is unexplained.
        top_right: The most probable hypothesis is the truth.
        top_probability: Its probability.
        covered: The set that is said to hold the truth in 90 % of all campaigns does; where none is said, the smallest
            set of hypotheses that reaches a probability of 0.9.
    """

    case: Case
    answer: Answer
    false_alarm: bool
    right_class: bool
    class_size: int
    alone: bool
    abstained: bool
    right_block: bool
    one_named: bool
    second: bool
    flagged: bool
    top_right: bool
    top_probability: float
    covered: bool


def judge(case: Case, answer: Answer) -> Judgement:
    """Judge an answer. "none" and "calibration" are one hypothesis, because a real rig is never exactly nominal."""
    failed, truth = answer.error is not None, case.truth
    size, one_speed = case.size or 0.0, len(case.speeds) == 1
    held = truth in answer.cause
    close = held and all(alike_sets(truth, member, case.channels, size, one_speed) for member in answer.cause)
    found = merged(answer)
    top = found[0] if found else (frozenset(), 1.0)  # a missing answer counts as a certain one
    return Judgement(
        case,
        answer,
        false_alarm=answer.verdict != "no_gap",
        right_class=close,
        class_size=len(answer.cause) if held else 0,
        alone=held and len(answer.cause) == 1,
        abstained=answer.verdict == "unexplained"
        or (answer.verdict == "ambiguous" and held)
        or (answer.verdict == "no_gap" and size < 1),
        right_block=right_block(case, answer),
        one_named=any(truth & member for member in answer.cause)
        and all(_touches(truth, member, case, one_speed) for member in answer.cause),
        second=failed or (bool(answer.cause) and all(len(member) > 1 for member in answer.cause)),
        flagged=answer.verdict == "unexplained",
        top_right=top[0] == truth,
        top_probability=top[1],
        covered=truth in (smallest_set(found) if answer.likely is None else set(map(named, answer.likely))),
    )


def _touches(truth: frozenset[str], member: frozenset[str], case: Case, one_speed: bool) -> bool:
    return any(
        alike_sets(frozenset({a}), frozenset({b}), case.channels, case.size or 0.0, one_speed)
        for a in truth
        for b in member
    )


def right_block(case: Case, answer: Answer) -> bool:
    """Whether an answer is in a block of the truth, see `blocks_hit`. Only effects of the vocabulary have a block."""
    return blocks_hit({EFFECTS[name].block for name in case.effects if name in EFFECTS}, answer)


def blocks_hit(blocks: Collection[str], answer: Answer) -> bool:
    """Whether the cause has an effect in one of the blocks.

    When unexplained: whether the block with the largest share of the gap, or one of those merged under its name, is one
    of them.
    """
    if answer.verdict == "unexplained" and answer.blocks:
        return not set(max(answer.blocks, key=answer.blocks.get).split("+")).isdisjoint(blocks)
    return any(EFFECTS[name].block in blocks for member in answer.cause for name in member)


def merged(answer: Answer) -> list[tuple[frozenset[str], float]]:
    """(effects, probability), the most probable first; the probability of "calibration" is added to "none"."""
    return ranked((one.effects, one.probability) for one in answer.which)


def ranked(hypotheses: Iterable[tuple[Iterable[str], float]]) -> list[tuple[frozenset[str], float]]:
    """As `merged`, of (effects, probability)."""
    total: dict[frozenset[str], float] = {}
    for effects, probability in hypotheses:
        key = named(effects)
        total[key] = total.get(key, 0.0) + probability
    return sorted(total.items(), key=lambda item: (-item[1], sorted(item[0])))


def smallest_set(found: Sequence[tuple[frozenset[str], float]]) -> set[frozenset[str]]:
    """The most probable hypotheses whose probabilities together reach LEVEL."""
    return {effects for effects, _ in found[: fewest([p for _, p in found], LEVEL - 1e-9)]}


SIZES = ((0.0, 1.0), (1.0, 10.0), (10.0, inf))  # multiples of the detection threshold


def size_range(case: Case) -> tuple[float, float] | None:
    """The range of SIZES that holds a case; None without an effect."""
    return None if case.size is None else next((lo, hi) for lo, hi in SIZES if lo <= case.size < hi)
