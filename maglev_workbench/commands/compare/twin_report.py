"""The benefit of diagnosis in tuning, as tables, page, markdown and JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.compare.twin_figures import NAMES, WORDS, before_after_figure
from maglev_workbench.page import markdown_table, note, number, page, table
from sim2real.blind.judging import worth
from sim2real.blind.judging.worth import CORRECTED, NOMINAL, SIMULATORS, TWIN, CaseWorth, Total, reduction, totals

if TYPE_CHECKING:
    import rich.table

SCHEMA = "maglev-twin/1"
TITLE = "What diagnosis is worth"
TOTAL_HEAD = (
    *("tuned on", "sum of regrets", "below nominal", "median peak |S|", "cases that fail", "simulated", "on the rig"),
    "failures of the rig",
)
PART_HEAD = ("answers", "cases", *(f"regret, {name}" for name in NAMES), "corrected below nominal")
CASE_HEAD = (
    *("campaign", "rig", "channels", "truth", "size", "answer", "right"),
    *(f"score, {name}" for name in NAMES),
    *(f"peak |S|, {name}" for name in NAMES),
    "failed",
)
GAIN_HEAD = ("campaign", "tuned on", "kp, A/m", "ki, A/m", "kd, A s/m", "promised", "on the twin")


@dataclass(frozen=True)
class Compared:
    """A finished comparison: its cases, budgets by simulator, seed, the description of the set, and its seal."""

    cases: Sequence[CaseWorth]
    budgets: Mapping[str, int]
    seed: int
    made: Mapping[str, Any]
    labels_sha256: str

    @property
    def reduction(self) -> tuple[float, float, float]:
        """Relative reduction of the regret by corrected simulators, with its interval."""
        return reduction(self.cases)

    @property
    def reached(self) -> bool:
        return self.reduction[0] >= worth.LEAST


def budget_words(budgets: Mapping[str, int]) -> str:
    """The budgets in words, and whether they were equal."""
    if len(set(budgets.values())) == 1:
        return f"equal budgets of {budgets[TWIN]} experiments"
    if budgets[NOMINAL] == budgets[CORRECTED]:
        return f"unequal budgets: {budgets[NOMINAL]} experiments on either simulator, {budgets[TWIN]} on the twin"
    return "unequal budgets: " + ", ".join(f"{n} {name}" for name, n in budgets.items())


def summary(found: Compared) -> str:
    """Sentences with the regrets, the reduction by corrected simulators, and whether it reaches the target."""
    of, (value, low, high) = totals(found.cases), found.reduction
    wanted = _share(worth.LEAST)
    sums = ", ".join(f"{of[name].regret:.2f} by the {WORDS[name]}" for name in SIMULATORS)
    cases = "1 case" if len(found.cases) == 1 else f"{len(found.cases)} cases"
    verdict = "reached" if found.reached else "missed"
    unsure = "" if (low >= worth.LEAST) == (high >= worth.LEAST) else ", which the interval does not settle"
    return (
        f"Regret on the twin, summed over {cases}, with {budget_words(found.budgets)}: {sums}. Corrected simulators "
        f"lose {_share(value)} [{_share(low)}, {_share(high)}] less than nominal ones; at least {wanted} was "
        f"wanted: {verdict}{unsure}."
    )


def how_to_read(found: Compared) -> str:
    b, runs = found.budgets, worth.AGAIN
    return (
        "The same tuner with the same seed starts from the preset gains on three simulators of every rig: the nominal "
        f"one ({b[NOMINAL]} experiments), the one that the diagnosis corrected ({b[CORRECTED]}), and the sealed twin "
        f"itself ({b[TWIN]}, which on a real rig would be experiments with a real rotor; those on simulators cost it "
        f"nothing). {_sentence(budget_words(b))}. The last quarter repeats the best-scored gains, where "
        f"the budget allows; what each recommends is run {runs} times on the twin with fresh noise. "
        "Regret: the best such mean of the case, the preset's included, less that of the gains; the "
        "tuner's own shortfall is in it, for all three alike. Cases: singles of at least 10 times the detection "
        "threshold, answered right or wrong; a diagnosis that names nothing corrects what it writes: parameters, and "
        "what a free correction finds. A case fails when the rotor touches down or a converter clips in any run. "
        "Promised: the score where the gains were tuned. "
        "Intervals: 95 %, bootstrap over cases. |S| is the nominal peak at the injection lines: up to 3 is zone A of "
        "ISO 14839-3, above 4 zone C."
    )


def twin_tables(found: Compared) -> "list[rich.table.Table]":
    """Tables for a terminal: scores and peak sensitivity by case, and the totals."""
    rows = [(c.id, c.truth, "yes" if c.right else "no", *(_both(c, name) for name in NAMES)) for c in found.cases]
    return [_grid(("case", "truth", "right", *NAMES), rows, "score | peak |S|"), _grid(TOTAL_HEAD, total_rows(found))]


def _grid(head: Sequence[str], rows: Sequence[Sequence[str]], title: str | None = None) -> "rich.table.Table":
    from rich import box
    from rich.table import Table

    grid = Table(box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False, title=title)
    for name in head:
        grid.add_column(name, justify="left" if name in ("case", "truth", "tuned on") else "right")
    for row in rows:
        grid.add_row(*row)
    return grid


def twin_page(found: Compared) -> str:
    """The HTML page."""
    sections = [
        ("Totals", table(TOTAL_HEAD, total_rows(found))),
        ("", note(how_to_read(found))),
        ("Before and after the diagnosis", before_after_figure(found.cases)),
        ("By answer", table(PART_HEAD, part_rows(found))),
        ("By case", table(CASE_HEAD, case_rows(found))),
        ("Gains", table(GAIN_HEAD, gain_rows(found))),
    ]
    return page(TITLE, summary(found), sections, _made_by(found))


def twin_markdown(found: Compared, command: str) -> str:
    """The same as markdown, without the plot."""
    parts = [f"# {TITLE}", summary(found), how_to_read(found), f"Made by `{command}`."]
    parts.append(markdown_table(TOTAL_HEAD, total_rows(found)))
    for heading, head, rows in (
        ("By answer", PART_HEAD, part_rows(found)),
        ("By case", CASE_HEAD, case_rows(found)),
        ("Gains", GAIN_HEAD, gain_rows(found)),
    ):
        parts += [f"## {heading}", markdown_table(head, rows)]
    parts += ["## What made this page", "\n".join(f"- {k}: {v}" for k, v in _made_by(found).items())]
    return "\n\n".join(parts) + "\n"


def twin_json(found: Compared) -> dict[str, Any]:
    """JSON data of schema maglev-twin/1. Reductions are (value, low, high); None if a loop failed."""
    return plain(
        {
            "schema": SCHEMA,
            "version": version("maglev-workbench"),
            "set": found.made,
            "labels_sha256": found.labels_sha256,
            "seed": found.seed,
            "budgets": found.budgets,
            "equal_budgets": len(set(found.budgets.values())) == 1,
            "runs_on_the_twin": worth.AGAIN,
            "totals": totals(found.cases),
            "reduction": {name: reduction(found.cases, name) for name in (CORRECTED, TWIN)},
            "least": worth.LEAST,
            "reached": found.reached,
            "cases": [
                {**asdict(c), "best": c.best, "regret": {name: c.regret(name) for name in NAMES}} for c in found.cases
            ],
        }
    )


def total_rows(found: Compared) -> list[tuple[str, ...]]:
    """Rows of the table with the columns TOTAL_HEAD."""
    of = totals(found.cases)
    return [_total_row(found, name, of[name]) for name in NAMES]


def _total_row(found: Compared, name: str, t: Total) -> tuple[str, ...]:
    below = "–"
    if name in (CORRECTED, TWIN):
        value, low, high = reduction(found.cases, name)
        below = f"{_share(value)} [{_share(low)}, {_share(high)}]"
    rig = name == TWIN
    return (
        WORDS[name],
        f"{t.regret:.2f} [{t.interval[0]:.2f}, {t.interval[1]:.2f}]",
        below,
        number(t.peak_sensitivity),
        f"{t.failures} of {len(found.cases)}",
        str(0 if rig else t.tried),
        str(t.tried if rig else 0),
        str(t.failed if rig else 0),
    )


def part_rows(found: Compared) -> list[tuple[str, ...]]:
    """Rows of the table with the columns PART_HEAD: for right answers and for the others."""
    rows = []
    for words, right in (("right", True), ("wrong or none", False)):
        if cases := [c for c in found.cases if c.right == right]:
            of = totals(cases)
            regrets = (f"{of[name].regret:.2f}" for name in NAMES)
            value, low, high = reduction(cases)
            rows.append((words, str(len(cases)), *regrets, f"{_share(value)} [{_share(low)}, {_share(high)}]"))
    return rows


def case_rows(found: Compared) -> list[tuple[str, ...]]:
    """Rows of the table with the columns CASE_HEAD."""
    rows = []
    for c in found.cases:
        scores = (f"{c.by[name].score:.3f}" for name in NAMES)
        peaks = (number(c.by[name].peak_sensitivity) for name in NAMES)
        failed = ", ".join(f"{name} {c.by[name].failures} of {worth.AGAIN}" for name in NAMES if c.by[name].failures)
        front = (c.id, c.rig, c.channels, c.truth, number(c.size), c.answer, "yes" if c.right else "no")
        rows.append((*front, *scores, *peaks, failed or "–"))
    return rows


def gain_rows(found: Compared) -> list[tuple[str, ...]]:
    """Rows of the table with the columns GAIN_HEAD."""
    return [
        (c.id, WORDS[name], *(number(g) for g in r.gains.values()), number(r.promised), f"{r.score:.3f}")
        for c in found.cases
        for name, r in ((name, c.by[name]) for name in NAMES)
    ]


def _both(c: CaseWorth, name: str) -> str:
    r = c.by[name]
    return f"{r.score:.2f} | {number(inf if r.failures else r.peak_sensitivity)}"


def _share(value: float) -> str:
    return f"{round(100 * value):d} %" if isfinite(value) else number(value)


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def _made_by(found: Compared) -> dict[str, object]:
    return {
        "Campaigns of the set": found.made.get("count"),
        "Seed of the set": found.made.get("seed"),
        "SHA-256 of the labels": found.labels_sha256,
        "Seed of tuning": found.seed,
        "Budgets": budget_words(found.budgets),
    }
