"""Results of the reproduced experiments as a page, as markdown and as JSON."""

from collections.abc import Sequence
from importlib.metadata import version
from math import isfinite
from typing import Any

from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.reproduce.contents import CONTENTS, contents_rows, contents_summary
from maglev_workbench.commands.reproduce.item import KINDS, Item, Kind, Outcome, Row
from maglev_workbench.page import facts, markdown_table, note, number, page, table

TITLE = "The dissertation's experiments, run anew"
ROUNDING = 1e-9  # smaller relative differences are rounding errors
HEAD = ("figure", "published", "ours", "difference", "tolerance", "verdict", "kind")
OVERVIEW = (
    *("experiment", "name", "predictions agree", "differ", "consequences agree", "differ", "fits agree", "differ"),
    *("counted elsewhere", "only shown"),
)
CONTENTS_TITLE = "Every table and figure"
CONTENTS_HEAD = ("table or figure", "shows", "state", "experiment", "why")
DIGITS = 4
HOW_TO_READ = (
    "Published: the dissertation's figure, or its words where it gives none. Ours: what the simulated rig and the "
    "estimators of this workbench give. Agrees or differs: within the tolerance of that row; a row without a verdict "
    "is only shown, and says why where a number is published. Kind: what an agreement is worth. A prediction has the "
    "published figure in nothing that it is made of. A consequence follows from the text's own figures or printed "
    "equations, or from a rig built with the published figure: an agreement tests arithmetic or the estimator, and a "
    "difference is a contradiction within the text. A fit agrees because something that the text leaves open was "
    "chosen so. A published figure counts once: a row marked 'again' is another way to a figure that the named "
    "experiment counts."
)

Done = Sequence[tuple[Item, Outcome]]


def cells(row: Row) -> tuple[str, ...]:
    """The cells of a row with the columns HEAD."""
    difference = row.difference
    known = difference is not None and isfinite(difference)
    shown = f"{100 * difference if abs(difference) > ROUNDING else 0:+.3g} %" if known else "–"
    verdict = {True: "agrees", False: "differs", None: "not compared" if known else ""}[row.agrees]
    kind = f"{row.kind or ''}{f', again: {row.again}' if row.again else ''}"
    found = _with_unit(number(row.found, DIGITS), row.unit)
    return (row.name, _published(row), found, shown, row.tolerance, verdict, kind)


def summary(done: Done) -> str:
    """The headline: predictions that agree and differ; consequences and fits apart."""
    rows = [row for _, outcome in done for row in outcome.rows]
    (good, bad), consequences, fits = (_agree_and_differ(rows, kind) for kind in KINDS)
    done_here = {item.name for item, _ in done}
    already = sum(row.again in done_here for row in rows)
    others = sum(bool(row.again) for row in rows) - already
    return (
        f"{len(done)} experiments, {len(rows)} figures. Of {good + bad} predictions of a published figure {good} agree "
        f"and {bad} differ. Counted apart: {sum(consequences)} consequences of the text's own figures "
        f"({consequences[0]} agree, {consequences[1]} differ) and {sum(fits)} fits ({fits[0]} agree, {fits[1]} "
        f"differ). {already} further rows are other ways to figures that are counted already"
        + (f", and {others} to figures that other experiments count, which were not run." if others else ".")
    )


def _agree_and_differ(rows: Sequence[Row], kind: Kind) -> tuple[int, int]:
    asked = [row.agrees for row in rows if row.counts and row.kind == kind]
    return asked.count(True), asked.count(False)


def _overview(done: Done) -> list[tuple[str, ...]]:
    """Rows with the number of figures of each item that agree and differ by kind, and of those not counted."""
    lines = []
    for item, outcome in done:
        counted = [n for kind in KINDS for n in _agree_and_differ(outcome.rows, kind)]
        elsewhere = sum(bool(row.again) for row in outcome.rows)
        shown = sum(row.agrees is None for row in outcome.rows)
        lines.append((item.title, item.name, *map(str, (*counted, elsewhere, shown))))
    return lines


def reproduce_page(done: Done, seed: int) -> str:
    """HTML: an overview, then every item's table, reasons, plots and notes."""
    sections = [("Overview", table(OVERVIEW, _overview(done)))]
    for item, outcome in done:
        reasons = [(row.name, row.reason) for row in outcome.rows if row.reason]
        text = table(HEAD, map(cells, outcome.rows)) + (facts(reasons) if reasons else "")
        sections.append((f"{item.title} ({item.source})", text))
        sections += [(one.heading, table(one.head, one.rows)) for one in outcome.tables]
        sections += outcome.plots
        sections.append(("", "".join(map(note, outcome.notes))))
    if _whole(done):
        sections.append((CONTENTS_TITLE, note(contents_summary()) + table(CONTENTS_HEAD, contents_rows())))
    sections.append(("How to read this", note(HOW_TO_READ)))
    return page(TITLE, summary(done), sections, {"Command": _command(done, seed), "Seed": seed})


def reproduce_markdown(done: Done, seed: int) -> str:
    """The same as markdown, without the plots."""
    parts = [f"# {TITLE}", summary(done), HOW_TO_READ, f"Made by `{_command(done, seed)} --docs FILE`."]
    parts.append(markdown_table(OVERVIEW, _overview(done)))
    for item, outcome in done:
        rows = [(*cells(row), row.reason) for row in outcome.rows]
        figures = markdown_table((*HEAD, "why"), rows)
        parts += [f"## {item.title}", f"`{item.name}`: {item.source}", figures]
        for one in outcome.tables:
            parts += [one.heading, markdown_table(one.head, one.rows)]
        parts += outcome.notes
    if _whole(done):
        parts += [f"## {CONTENTS_TITLE}", contents_summary(), markdown_table(CONTENTS_HEAD, contents_rows())]
    return "\n\n".join(parts) + "\n"


def reproduce_json(done: Done, seed: int) -> dict[str, Any]:
    """Everything except the plots as JSON data, schema maglev-reproduce/2."""
    return plain(
        {
            "schema": "maglev-reproduce/2",
            "version": version("maglev-workbench"),
            "seed": seed,
            "items": [
                {
                    "name": item.name,
                    "title": item.title,
                    "source": item.source,
                    "rows": [
                        {**vars(row), "difference": row.difference, "tolerance": row.tolerance, "agrees": row.agrees}
                        for row in outcome.rows
                    ],
                    "tables": [vars(one) for one in outcome.tables],
                    "notes": outcome.notes,
                }
                for item, outcome in done
            ],
            "contents": [vars(entry) for entry in CONTENTS] if _whole(done) else [],
        }
    )


def _published(row: Row) -> str:
    if row.published is None:
        return "–"
    return row.published if isinstance(row.published, str) else _with_unit(f"{row.published:g}", row.unit)


def _with_unit(text: str, unit: str) -> str:
    return f"{text} {unit}".strip()


def _whole(done: Done) -> bool:
    """Whether every experiment was done."""
    from maglev_workbench.commands.reproduce.registry import HOME

    return len(done) == len(HOME)


def _command(done: Done, seed: int) -> str:
    names = "" if _whole(done) else "".join(f" {item.name}" for item, _ in done)
    return f"maglev reproduce{names} --seed {seed}"
