"""Coverage as a table, as JSON and as markdown."""

from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import Any

from rich.table import Table

from maglev_workbench.commands.coverage.conditions import CONDITIONS
from maglev_workbench.commands.coverage.counts import Coverage
from maglev_workbench.page import markdown_table, number

SCHEMA = "maglev-coverage/2"
NOTHING = "–"
HEAD = ("condition", "quantity", "covered", "95 % interval", "z", "half width", "not bounded")
HOW_TO_READ = """\
Each line counts the 95 % intervals of `maglev estimate` that hold the truth, over experiments with other excitations
and other noise; z is the distance of the estimate from the truth in standard errors, as mean and standard deviation,
which should be 0 +- 1. The half width is the median, of the truth's size; the last column is the share of draws in
which the estimate says that it cannot tell.

Of experiments that repeat, the truth is the best linear approximation, the mean over the same experiments without
noise: of stiffness and damping the mean over a band of 15 Hz, of the margins those of the mean sensitivity. From the
injection alone, gain, stiffness and damping are those of the rig.

Of recordings that do not repeat, the truth is the linearisation of the rig that is drawn: it differs from the one that
the estimate is told by what its [tolerance] allows, of a suspended ball also by the form of its force law, and its
command comes late by up to a sample. A recording has 20,000 samples at the control rate, converters and noise as the
rig states them, displacement, command and current, and goes through the reader of campaigns. Only the gains of the
controller are known; noise on the command is stored nowhere.
"""

Found = Mapping[str, Sequence[Coverage]]


def _rows(found: Found) -> Iterator[tuple[str, ...]]:
    for name, rows in found.items():
        for i, row in enumerate(rows):
            title = f"{name}: {CONDITIONS[name].title}" if i == 0 else ""
            covered = NOTHING if row.covered is None else number(row.covered, 3)
            within = NOTHING if row.interval is None else "{:.3f} .. {:.3f}".format(*row.interval)
            z = NOTHING if row.bias is None else f"{row.bias:+.2f} +- {row.spread:.2f}"
            half = NOTHING if row.half_width is None else f"{100 * row.half_width:.2g} %"
            abstained = f"{row.abstained / (row.draws + row.abstained):.0%}" if row.abstained else NOTHING
            yield title, row.quantity.replace("_", " "), covered, within, z, half, abstained


def coverage_table(found: Found) -> Table:
    """The table for a terminal."""
    table = Table(*HEAD)
    for row in _rows(found):
        table.add_row(*row)
    return table


def coverage_json(found: Found, seed: int) -> dict[str, Any]:
    """The counts, in SI."""
    conditions = {
        name: [vars(row) | {"covered": row.covered, "covered_ci": row.interval} for row in rows]
        for name, rows in found.items()
    }
    return {"schema": SCHEMA, "version": version("maglev-workbench"), "seed": seed, "conditions": conditions}


def coverage_markdown(found: Found, draws: int, seed: int) -> str:
    """A document of its own, with the command that makes it again."""
    of = "" if list(found) == list(CONDITIONS) else " ".join(found) + " "
    head = (
        "# Coverage of the intervals\n\n"
        f"Made by `maglev coverage {of}--draws {draws} --seed {seed} --docs docs/coverage.md`.\n\n{HOW_TO_READ}\n"
    )
    return head + markdown_table(HEAD, list(_rows(found))) + "\n"
