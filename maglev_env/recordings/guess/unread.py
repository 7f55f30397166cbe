"""Columns that were to be channels by their names, whose cells hold numbers that could not be read."""

import re
from collections.abc import Iterable

from maglev_env.recordings.guess.units import header_unit
from maglev_env.recordings.guess.words import meaning

# What a file says of a column whose cells are no numbers: its name, and the first of them.
_SAID = re.compile(r"column (?P<q>['\"])(?P<name>.*)(?P=q): (?P<why>(?P<p>['\"])(?P<cell>.*)(?P=p) in line \d+.*)")
_PLACE = re.compile(r"\[\d+\]")


def unread_columns(unused: Iterable[str]) -> dict[str, str]:
    """Of what was left out of a file, the columns to mend, and why they were not read.

    Texts, such as a state or a remark, are no loss, and neither is a date.

    Args:
        unused: what was left out and why, as `Contents` says it.
    """
    found = {}
    for said in filter(None, map(_SAID.fullmatch, unused)):
        label, unit = header_unit(said["name"])
        channel = meaning(label, unit.si if unit else "").channel
        wanted = channel not in (None, "", "time") or _PLACE.fullmatch(said["name"])
        if wanted and re.search(r"\d", said["cell"]):
            found[said["name"]] = said["why"]
    return found
