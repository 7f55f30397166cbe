"""Scores of methods on a set of the benchmark, beside an oracle that knows the generator."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from sim2real.blind.cases import Answer, Case, open_labels, read_answer, seal_of
from sim2real.blind.judging.alike import alike_sets
from sim2real.blind.judging.calibration import calibration_error, debiased_error
from sim2real.blind.judging.judging import SIZES, Judgement, blocks_hit, judge, size_range
from sim2real.blind.judging.scoring import Row, row, size_words, statistic_row
from sim2real.judgement.mechanisms import OF_ONE_MAGNET

SMALL, MEDIUM, LARGE = SIZES


@dataclass(frozen=True)
class Score:
    """A share of the campaigns of some kinds and sizes (None: any), and whether the oracle is good on one."""

    name: str
    kinds: tuple[str, ...]
    sizes: tuple[tuple[float, float], ...] | None
    good: Callable[[Judgement], bool]
    oracle: Callable[[Case], bool] | None = None
    tellable: bool | None = None


EFFECT = ("single", "pair", "unknown")
VISIBLE = (MEDIUM, LARGE)


def rivals_of(case: Case) -> list[frozenset[str]]:
    """Explanations that the oracle cannot reject, besides the true one, by the names of their mechanisms."""
    found = [mechanism(one["effects"], case) for one in case.label.get("oracle", {}).get("rivals", [])]
    return [effects for effects in dict.fromkeys(found) if effects != mechanism(case.effects, case)]


def tellable(case: Case) -> bool:
    """Whether the oracle rejects every explanation but the true one."""
    return not rivals_of(case)


def told(j: Judgement) -> bool:
    """The truth and nothing else: the cause alone, "unexplained" of an unknown, "no_gap" of none."""
    verdict = {"none": "no_gap", "unknown": "unexplained"}.get(j.case.kind)
    return j.alone if verdict is None else j.answer.verdict == verdict


def honest(j: Judgement) -> bool:
    """Told, or the right class, or an abstention."""
    return told(j) or j.right_class or j.abstained


SCORES = (
    Score("false alarm", ("none",), None, lambda j: j.false_alarm, lambda c: False),
    Score("told, of what can be told", EFFECT, VISIBLE, told, lambda c: True, True),
    Score("told, of what can be told: singles", ("single",), VISIBLE, told, lambda c: True, True),
    Score("told, of what can be told: pairs", ("pair",), VISIBLE, told, lambda c: True, True),
    Score("told, of what can be told: unknowns", ("unknown",), VISIBLE, told, lambda c: True, True),
    Score("honest where it cannot be told", EFFECT, VISIBLE, honest, lambda c: True, False),
    Score("right class", ("single",), (LARGE,), lambda j: j.right_class, lambda c: True),
    Score("right class or correct abstention", ("single",), (MEDIUM,), honest, lambda c: True),
    Score("right block", ("single", "unknown"), VISIBLE, lambda j: _right_block(j), lambda c: True),
    Score("pairs: both named", ("pair",), None, lambda j: j.right_class, tellable),
    Score("pairs: at least one named", ("pair",), None, lambda j: j.one_named, lambda c: True),
    Score("spurious second effect", ("single",), None, lambda j: j.second, lambda c: False),
    Score("unknown flagged", ("unknown",), VISIBLE, lambda j: j.flagged, tellable),
    Score("90 % set holds the truth", ("none", *EFFECT), None, lambda j: j.covered),
)


@dataclass(frozen=True)
class Method:
    """A method's answers to a set, judged.

    Attributes:
        name: Name of the folder of its answers.
        version: What gave the answers; several, separated by commas, if they differ.
        judged: The judgement of each campaign.
        failed: Number of campaigns without an answer or with an error.
        rows: Its figures, in the order of `names`.
    """

    name: str
    version: str
    judged: tuple[Judgement, ...]
    failed: int
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Benchmark:
    """A scored set: the seal of its labels, its cases, the figures of the oracle, and each method."""

    labels_sha256: str
    cases: tuple[Case, ...]
    oracle: tuple[Row, ...]
    methods: tuple[Method, ...]


def score_set(folder: Path, answers: Sequence[Path]) -> Benchmark:
    """Check the seal of a set and score folders of answers to it.

    Raises:
        ValueError: The labels were changed, an answer is missing or invalid, or belongs to another set.
    """
    seal, cases = seal_of(folder), open_labels(folder)
    methods = []
    for path in answers:
        found = [read_answer(path / f"{case.id}.json", seal) for case in cases]
        judged = tuple(judged_with_rivals(case, answer) for case, answer in zip(cases, found, strict=True))
        versions = ", ".join(sorted({a.version for a in found}))
        failed = sum(a.error is not None for a in found)
        methods.append(Method(path.name, versions, judged, failed, rows_of(judged)))
    return Benchmark(seal, cases, tuple(_of_oracle(score, cases) for score in SCORES), tuple(methods))


def judged_with_rivals(case: Case, answer: Answer) -> Judgement:
    """As `judge`; what the oracle cannot reject may stand beside the truth, as what is alike on all campaigns may."""
    case, answer = by_mechanism(case, answer)
    j = judge(case, answer)
    others = [member for member in answer.cause if member != case.truth]
    size, one_speed, rivals = case.size or 0.0, len(case.speeds) == 1, rivals_of(case)
    close = all(m in rivals or alike_sets(case.truth, m, case.channels, size, one_speed) for m in others)
    return replace(j, right_class=case.truth in answer.cause and close)


def mechanism(effects: Iterable[str], case: Case) -> frozenset[str]:
    """Effects on a case by the names of their mechanisms: a ball hangs below a single magnet, see `OF_ONE_MAGNET`."""
    return frozenset(OF_ONE_MAGNET.get(name, name) if case.rig == "ball" else name for name in effects)


def by_mechanism(case: Case, answer: Answer) -> tuple[Case, Answer]:
    """Truth and answer by the names of their mechanisms."""
    which = tuple(replace(h, effects=mechanism(h.effects, case)) for h in answer.which)
    cause = tuple(dict.fromkeys(mechanism(effects, case) for effects in answer.cause))
    likely = None if answer.likely is None else tuple(mechanism(effects, case) for effects in answer.likely)
    own = replace(case, effects=mechanism(case.effects, case))
    return own, replace(answer, cause=cause, which=which, likely=likely)


def _right_block(j: Judgement) -> bool:
    """As `judging.right_block`, for what no vocabulary holds too, whose block the label states."""
    return blocks_hit(j.case.label["blocks"], j.answer) if j.case.kind == "unknown" else j.right_block


def _belongs(score: Score, case: Case) -> bool:
    return (
        case.kind in score.kinds
        and (score.sizes is None or size_range(case) in score.sizes)
        and (score.tellable is None or tellable(case) == score.tellable)
    )


def _share(score: Score, good: Sequence[bool]) -> Row:
    sizes = "" if score.sizes is None else f", {size_words((score.sizes[0][0], score.sizes[-1][1]))}"
    if not good:
        return row(score.name + sizes, nan, (nan, nan), 0, "share", None)
    ci = binomtest(sum(good), len(good)).proportion_ci(method="wilson")
    return row(score.name + sizes, sum(good) / len(good), (ci.low, ci.high), len(good), "share", None)


def _of_oracle(score: Score, cases: Sequence[Case]) -> Row:
    return _share(score, [score.oracle(c) for c in cases if _belongs(score, c)] if score.oracle else [])


def rows_of(judged: Sequence[Judgement]) -> tuple[Row, ...]:
    """The figures of a method, in the order of SCORES and then what is no share."""
    top = np.array([(j.top_probability, j.top_right) for j in judged], dtype=float).reshape(-1, 2)
    # Of an unknown cause nothing is named, so nothing can be closed.
    large = (j for j in judged if j.case.kind in ("single", "pair") and size_range(j.case) == LARGE)
    closed = [j.answer.closed_fraction for j in large if told(j)]
    seconds = [j.answer.seconds for j in judged]
    return (
        *(_share(score, [score.good(j) for j in judged if _belongs(score, j.case)]) for score in SCORES),
        statistic_row("calibration error", top, calibration_error),
        statistic_row("calibration error, debiased", top, debiased_error),
        statistic_row(f"median closed fraction of what was told, {size_words(LARGE)}", closed, np.median),
        statistic_row("median time per campaign", seconds, np.median, "s"),
        statistic_row("mean time per campaign", seconds, np.mean, "s"),
    )


def misses(method: Method) -> list[Judgement]:
    """Visible campaigns that can be told and were not, and false alarms."""
    wrong = [j for j in method.judged if j.case.kind == "none" and j.false_alarm]
    sized = [j for j in method.judged if j.case.kind in EFFECT and size_range(j.case) in VISIBLE]
    return wrong + [j for j in sized if tellable(j.case) and not told(j)]


def by_family(method: Method) -> Mapping[str, Row]:
    """The headline by family of rigs."""
    families = sorted({j.case.rig for j in method.judged})
    return {
        name: _share(SCORES[1], [told(j) for j in method.judged if j.case.rig == name and _belongs(SCORES[1], j.case)])
        for name in families
    }
