"""Coverage as a table, as JSON and as markdown."""

from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import Any

from rich.table import Table

from maglev_workbench.commands.coverage.conditions import CONDITIONS
from maglev_workbench.commands.coverage.study import Coverage
from maglev_workbench.page import markdown_table, number

SCHEMA = "maglev-coverage/1"
HEAD = ("condition", "quantity", "covered", "95 % interval", "half width")
HOW_TO_READ = (
    "Each line counts the 95 % intervals of `maglev estimate` that hold the truth, over experiments with other phases "
    "and other noise. The truth is the best linear approximation, the mean over the same experiments without noise: of "
    "stiffness and damping the mean over a band of 15 Hz, of the margins those of the mean sensitivity. From the "
    "injection alone, gain, stiffness and damping are those of the rig. The half width is the median, of the truth."
)

Found = Mapping[str, Sequence[Coverage]]


def _rows(found: Found) -> Iterator[tuple[str, ...]]:
    for name, rows in found.items():
        for i, row in enumerate(rows):
            low, high = row.interval
            half = "–" if row.half_width is None else f"{100 * row.half_width:.2g} %"
            title = f"{name}: {CONDITIONS[name].title}" if i == 0 else ""
            yield title, row.quantity, number(row.held / row.draws, 3), f"{low:.3f} .. {high:.3f}", half


def coverage_table(found: Found) -> Table:
    """The table for a terminal."""
    table = Table(*HEAD)
    for row in _rows(found):
        table.add_row(*row)
    return table


def coverage_json(found: Found, seed: int) -> dict[str, Any]:
    """The counts, in SI."""
    conditions = {
        name: [vars(row) | {"covered": row.held / row.draws, "covered_ci": row.interval} for row in rows]
        for name, rows in found.items()
    }
    return {"schema": SCHEMA, "version": version("maglev-workbench"), "seed": seed, "conditions": conditions}


def coverage_markdown(found: Found, draws: int, seed: int) -> str:
    """A document of its own, with the command that makes it again."""
    of = "" if list(found) == list(CONDITIONS) else " ".join(found) + " "
    head = (
        "# Coverage of the intervals\n\n"
        f"Made by `maglev coverage {of}--draws {draws} --seed {seed} --docs docs/coverage.md`.\n\n{HOW_TO_READ}\n\n"
    )
    return head + markdown_table(HEAD, list(_rows(found))) + "\n"
