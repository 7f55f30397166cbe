"""Coverage as a table, as JSON and as markdown."""

import re
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from rich.table import Table

from maglev_workbench.commands.coverage.conditions import CONDITIONS, GROUPS
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

Of experiments that repeat, the truth is the best linear approximation at the stated power: what the mean response of
the same experiments without noise gives, of stiffness and damping over a band of 15 Hz, of the margins those of the
mean sensitivity. Where the law is not smooth (friction, hysteresis), noise in the loop is part of what responds, and
the mean is that of the noisy experiments. From the injection alone, gain, stiffness and damping are those of the rig;
of x-y rigs the truth is the mean of the estimates without noise. The intervals of the gain margins are knowingly
cautious where the loop gain is near its noise. The mass is that of the rig: what its [tolerance] adds to the intervals
of `maglev estimate` is not counted here. A rotor that turns is a tone, which is taken out before the lines are
looked at. Lines at which noise or distortion drowns the loop gain are left out of the margins; near a peak they tell it
although S is noisy. The 2,000 draws of an interval are the same for all recordings: half a percent that all conditions
share. Known to cover less: the peak sensitivity where a floor shakes there; and the stiffness of x-y rigs that are
bent, or where distortion is half of the noise, which does not tell it (three times the force), most of all in the band
of the resonance, which is not counted here.

Of recordings that do not repeat, the truth is the linearisation of the rig that is drawn: it differs from the one that
the estimate is told by what its [tolerance] allows, of a suspended ball also by the form of its force law, and its
command comes late by up to a sample. A recording has 20,000 samples at the control rate, converters and noise as the
rig states them, displacement, command and current, and goes through the reader of campaigns. Only the gains of the
controller are known; noise on the command is stored nowhere.
"""

LAST = "A condition that several of these commands count has the rows of the last of them."

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


def coverage_markdown(found: Found, draws: int, seed: int, before: str = "") -> str:
    """A page with the commands that make it again; of a page that is there the conditions that were not counted stay.

    Args:
        found: counts by condition.
        draws: of each condition.
        seed: of the study.
        before: the page as it is.
    """
    page = f"# Coverage of the intervals\n\n{HOW_TO_READ}\n"
    for group, (title, conditions) in GROUPS.items():
        counted = {name: rows for name, rows in found.items() if name in conditions}
        section = before.partition(f"## {title}\n")[2].partition("\n## ")[0].rstrip("\n")
        if counted:
            stored = _stored(section)
            old = {name: stored[name] for name in conditions if name in stored and name not in counted}
            names = group if list(counted) == list(conditions) else " ".join(counted)
            spread = np.sqrt(0.95 * 0.05 / draws)
            made_by = [line for line, of in _commands(section) if old.keys() & of]
            made_by.append(
                f"Made by `maglev coverage {names} --draws {draws} --seed {seed} --docs docs/coverage.md`; a share "
                f"of 0.95 has a standard deviation of {spread:.2g}."
            )
            if len(made_by) > 1:
                made_by.append(LAST)
            lines = old | {name: _lines({name: rows})[2:] for name, rows in counted.items()}
            table = [*_lines({}), *(line for name in conditions for line in lines.get(name, ()))]
            section = "\n" + "\n\n".join([*made_by, "\n".join(table)])
        if section:
            page += f"## {title}\n{section}\n\n"
    return page.rstrip("\n") + "\n"


def _lines(found: Found) -> list[str]:
    """The table of some conditions, two lines of head first."""
    return markdown_table(HEAD, list(_rows(found))).splitlines()


def _stored(section: str) -> dict[str, list[str]]:
    """The lines of a stored table by condition."""
    found: dict[str, list[str]] = {}
    name = ""
    for line in section.splitlines():
        if line.startswith("| ") and not line.startswith(("| ---", f"| {HEAD[0]} |")):
            name = line.removeprefix("| ").partition(" | ")[0].partition(":")[0].strip() or name
            found.setdefault(name, []).append(line)
    return found


def _commands(section: str) -> Iterator[tuple[str, set[str]]]:
    """The stored lines that say which command made a table, and the conditions that it counted."""
    for line in section.splitlines():
        if command := re.match(r"Made by `maglev coverage (.*?) --draws", line):
            words = command.group(1).split()
            yield line, {name for word in words for name in (GROUPS[word][1] if word in GROUPS else (word,))}
