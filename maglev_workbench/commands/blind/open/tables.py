"""The tables of a blind check as text, for the page, the markdown and the console."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite

from maglev_workbench.page import number
from sim2real.blind.judging.alike import ALIKE, ALWAYS, AT_ONE_SPEED
from sim2real.blind.judging.opening import Opened
from sim2real.blind.judging.scoring import LARGE, Row, answer_words, confusion, named_in_class, size_words, truth_words

HEAD = ("figure", "value", "95 % interval", "n", "floor", "ambitious", "verdict")
DEFINITIONS = (
    "Every campaign counts; one without an answer is wrong in every row. Sizes are multiples of the size at which a 1 "
    "% chi-square test on that campaign detects the effect half of the time. Intervals: Wilson's for shares, "
    "bootstrap for the rest. A verdict in brackets could turn out otherwise: its interval holds the floor.",
    "Right class: the true effect is in the cause, and every other effect of an ambiguous cause is one that looks "
    "alike on these channels (table below); an unlike member makes the answer wrong. Named alone: nothing else is in "
    "the cause. Correct abstention: an ambiguous cause with the true effect in it, or the verdict unexplained; no_gap "
    "counts only below the threshold, and so never in the rows above it.",
    "Right block: an effect of the cause sits in the block of the true one; of the verdict unexplained, the block "
    "with the largest share of the gap, or one merged with it, is that block. Pairs, both: as right class, for the "
    "pair; at least one: every member of the cause holds a true effect, or one alike, and some member by name. "
    "Spurious second effect: a single answered by a pair. Unknown flagged: verdict unexplained.",
    "Calibration error: of the probability of the most probable hypothesis, in ten bins, weighted; none and "
    "calibration count as one hypothesis, and only the true effects by name are right. Chance alone gives more than "
    "0. The 90 % set is the smallest one that reaches that probability.",
    "Regret: on the twin, the score of the best of twelve gain sets less that of the set which a simulator "
    "recommends, summed over singles of at least 10 times the threshold, the first 24 of them, right or wrong; "
    "corrected simulator against nominal one. A diagnosis that names nothing corrects nothing. Closed fraction: as "
    "the diagnosis states it on the holdout recording, of right answers. Time: of one diagnosis in a process of its "
    "own, one beside it on every other core.",
    "Checked when the set was opened: the labels have the hash that was written when they were made, and all answers "
    "are to these labels and by one version of the code, which gave some of them again where this is said below. An "
    "opened set cannot be answered again. That the hash was published before the first answer, and that no answer was "
    "deleted, is for its maker to say.",
)


@dataclass(frozen=True)
class TextTable:
    """A heading, the names of the columns and rows of text."""

    heading: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]


def tables(opened: Opened) -> list[TextTable]:
    """All tables that follow the table of the targets."""
    return [
        _parts("By size", opened.by_size),
        _parts("By channel set", opened.by_channels),
        _parts("By rig", opened.by_rig),
        _class_sizes(opened),
        _confusion(opened),
        _wrong(opened),
        _regret(opened),
        alike(),
    ]


def amount(value: float, unit: str) -> str:
    """A figure as text in its unit."""
    if not isfinite(value):
        return number(value)
    if unit == "share":
        return f"{100 * value:.1f} %"
    return f"{number(value)} {unit}".strip()


def cells(row: Row) -> tuple[str, ...]:
    """A figure as the cells of a row with the columns HEAD."""
    interval = f"{amount(row.low, row.unit)} .. {amount(row.high, row.unit)}" if row.n else "–"
    target = row.target
    verdict = row.verdict if row.decided or row.verdict in ("", "no cases") else f"({row.verdict})"
    floor, best = ("", "") if target is None else (_floor(row), _best(row))
    return (row.name, amount(row.value, row.unit), interval, str(row.n), floor, best, verdict)


def _floor(row: Row) -> str:
    return f"{'<=' if row.target.at_most else '>='} {_round(row.target.floor, row.unit)}"


def _best(row: Row) -> str:
    low, high = row.target.ambitious
    if row.target.at_most:
        return f"<= {_round(high, row.unit)}"
    if high in (1.0, inf):
        return f">= {_round(low, row.unit)}"
    return f"{_round(low, row.unit)} .. {_round(high, row.unit)}"


def _round(value: float, unit: str) -> str:
    """A target as text, with only the digits with which it was set."""
    return f"{100 * value:g} %" if unit == "share" else f"{value:g} {unit}".strip()


def missed(opened: Opened) -> list[str]:
    """Descriptions of the figures that miss their floor, and of those that so few campaigns cannot decide."""
    words = {True: "misses the floor", False: "misses the floor, which its interval holds"}
    unsure = "meets the floor, which its interval holds"
    return [
        f"{r.name}: {amount(r.value, r.unit)} {words[r.decided] if r.verdict == 'missed' else unsure} ({_floor(r)})"
        for r in opened.rows
        if r.target and r.n and (r.verdict == "missed" or not r.decided)
    ]


def _parts(heading: str, parts: Mapping[str, Sequence[Row]]) -> TextTable:
    """A table with a row per figure and a column per part: value, interval and number of campaigns."""
    across = list(parts.values())
    rows = []
    for same in zip(*across, strict=True):
        texts = [
            f"{amount(r.value, r.unit)} [{amount(r.low, r.unit)}, {amount(r.high, r.unit)}] of {r.n}" for r in same
        ]
        rows.append((same[0].name, *(text if r.n else "–" for text, r in zip(texts, same, strict=True))))
    return TextTable(heading, ("figure", *parts), rows)


def _class_sizes(opened: Opened) -> TextTable:
    found = sorted(named_in_class(opened.judged).items())
    words = {0: "true effect not in the cause", 1: "named alone"}
    rows = [(words.get(k, f"named in a class of {k}"), str(n)) for k, n in found]
    return TextTable(f"Singles, {size_words(LARGE)}, by size of the class named", ("answer", "campaigns"), rows)


def _confusion(opened: Opened) -> TextTable:
    found: dict[str, list[str]] = {}
    for (truth, answer), n in sorted(confusion(opened.judged).items(), key=lambda item: (item[0][0], -item[1])):
        found.setdefault(truth, []).append(f"{answer} ({n})")
    rows = [(truth, "; ".join(answers)) for truth, answers in found.items()]
    return TextTable("Truth and answers", ("truth", "answers (campaigns)"), rows)


def _wrong(opened: Opened) -> TextTable:
    """Large single effects that were not named, which are the first errors to investigate."""
    rows = []
    for j in sorted(opened.judged, key=lambda j: j.case.id):
        if j.case.kind == "single" and (j.case.size or 0) >= LARGE[0] and not j.right_class:
            words = j.answer.error or answer_words(j)
            rows.append((j.case.id, j.case.rig, j.case.channels, truth_words(j), number(j.case.size), words))
    heading = f"Singles, {size_words(LARGE)}, that were missed"
    return TextTable(heading, ("campaign", "rig", "channels", "truth", "size", "answer"), rows)


def _regret(opened: Opened) -> TextTable:
    rows = [(c.id, *(f"{v:.3f}" for v in (c.best, c.nominal, c.corrected))) for c in opened.regrets]
    head = ("campaign", "best of the sets", "nominal simulator's choice", "corrected simulator's choice")
    return TextTable("Scores on the twin", head, rows)


def alike() -> TextTable:
    """Which effects recordings of each kind cannot tell apart."""
    rows = [
        (channels, ", ".join(sorted(members)), "any" if up_to == inf else f"< {up_to:g} x")
        for channels, classes in ALIKE.items()
        for members, up_to in classes
    ]
    rows += [("any", ", ".join(sorted(ALWAYS)), "any"), ("any, at one speed", ", ".join(sorted(AT_ONE_SPEED)), "any")]
    return TextTable("Effects that look alike", ("channels", "effects", "size"), rows)
