"""Results of the reproduced experiments as a page, as markdown and as JSON."""

from collections.abc import Sequence
from importlib.metadata import version
from math import isfinite
from typing import Any

from maglev_env.recordings.json_data import plain
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row
from maglev_workbench.page import facts, markdown_table, note, number, page, table

TITLE = "The dissertation's experiments, run anew"
ROUNDING = 1e-9  # smaller relative differences are rounding errors
HEAD = ("figure", "published", "ours", "difference", "verdict")
OVERVIEW = ("experiment", "name", "agree", "differ", "only shown")
DIGITS = 4
HOW_TO_READ = (
    "Published: the dissertation's figure, or its words where it gives none. Ours: what the simulated rig and the "
    "estimators of this workbench give. Agrees or differs: within the tolerance of that row, which the JSON states; a "
    "row without a verdict is only shown. Where the rig was built from the published figure, the row says so: it then "
    "tests the estimator, not the physics."
)

Done = Sequence[tuple[Item, Outcome]]


def cells(row: Row) -> tuple[str, ...]:
    """The cells of a row with the columns HEAD."""
    difference = row.difference
    known = difference is not None and isfinite(difference)
    shown = f"{100 * difference if abs(difference) > ROUNDING else 0:+.3g} %" if known else "–"
    verdict = {True: "agrees", False: "differs", None: ""}[row.agrees]
    return (row.name, _published(row), _with_unit(number(row.found, DIGITS), row.unit), shown, verdict)


def summary(done: Done) -> str:
    """One sentence with the number of figures that agree."""
    asked = [row.agrees for _, outcome in done for row in outcome.rows if row.agrees is not None]
    figures = sum(len(outcome.rows) for _, outcome in done)
    return (
        f"{len(done)} experiments, {figures} figures: of {len(asked)} that can be compared in numbers, "
        f"{sum(asked)} agree with the published ones and {len(asked) - sum(asked)} differ."
    )


def _overview(done: Done) -> list[tuple[str, ...]]:
    """Rows with the number of figures of each item that agree, differ, and are only shown."""
    rows = []
    for item, outcome in done:
        asked = [row.agrees for row in outcome.rows]
        rows.append((item.title, item.name, *(str(asked.count(v)) for v in (True, False, None))))
    return rows


def reproduce_page(done: Done, seed: int) -> str:
    """HTML: an overview, then every item's table, reasons, plots and notes."""
    sections = [("Overview", table(OVERVIEW, _overview(done)))]
    for item, outcome in done:
        reasons = [(row.name, row.reason) for row in outcome.rows if row.reason]
        text = table(HEAD, map(cells, outcome.rows)) + (facts(reasons) if reasons else "")
        sections.append((f"{item.title} ({item.source})", text))
        sections += outcome.plots
        sections.append(("", "".join(map(note, outcome.notes))))
    sections.append(("How to read this", note(HOW_TO_READ)))
    return page(TITLE, summary(done), sections, {"Command": _command(done, seed), "Seed": seed})


def reproduce_markdown(done: Done, seed: int) -> str:
    """The same as markdown, without the plots."""
    parts = [f"# {TITLE}", summary(done), HOW_TO_READ, f"Made by `{_command(done, seed)} --docs FILE`."]
    parts.append(markdown_table(OVERVIEW, _overview(done)))
    for item, outcome in done:
        rows = [(*cells(row), row.reason) for row in outcome.rows]
        figures = markdown_table((*HEAD, "why"), rows)
        parts += [f"## {item.title}", f"`{item.name}`: {item.source}", figures, *outcome.notes]
    return "\n\n".join(parts) + "\n"


def reproduce_json(done: Done, seed: int) -> dict[str, Any]:
    """Everything except the plots as JSON data, schema maglev-reproduce/1."""
    return plain(
        {
            "schema": "maglev-reproduce/1",
            "version": version("maglev-workbench"),
            "seed": seed,
            "items": [
                {
                    "name": item.name,
                    "title": item.title,
                    "source": item.source,
                    "rows": [{**vars(row), "difference": row.difference, "agrees": row.agrees} for row in outcome.rows],
                    "notes": outcome.notes,
                }
                for item, outcome in done
            ],
        }
    )


def _published(row: Row) -> str:
    if row.published is None:
        return "–"
    return row.published if isinstance(row.published, str) else _with_unit(f"{row.published:g}", row.unit)


def _with_unit(text: str, unit: str) -> str:
    return f"{text} {unit}".strip()


def _command(done: Done, seed: int) -> str:
    from maglev_workbench.commands.reproduce.registry import HOME

    names = "" if len(done) == len(HOME) else "".join(f" {item.name}" for item, _ in done)
    return f"maglev reproduce{names} --seed {seed}"
