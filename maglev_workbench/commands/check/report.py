"""What a recording is good for, and its quality: tables for the terminal, a section of the page, JSON."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rich.markup import escape
from rich.table import Table

from maglev_env.recordings.quality import Quality
from maglev_workbench.commands.check.uses import COMMANDS, Use
from maglev_workbench.page import table as html_table

_HEAD = ("command", "usable", "why", "record instead")


def uses_table(file: str, found: Sequence[Use]) -> Table:
    """What each command makes of a recording."""
    table = Table(*_HEAD, title=f"{file}: usable for")
    for use in found:
        style = {"yes": None, "with care": "yellow", "no": "red"}[use.verdict]
        table.add_row(use.command, use.verdict, escape(use.reason), escape(use.instead), style=style)
    return table


def uses_sections(found: Sequence[tuple[str, Sequence[Use]]]) -> list[tuple[str, str]]:
    """The same as a section of a page."""
    rows = [(file, u.command, u.verdict, u.reason, u.instead) for file, of in found for u in of]
    html = html_table(("recording", *_HEAD), rows)
    for cell, wrapped in (("<th>", "left"), ("<td>", "left; white-space: normal")):
        html = html.replace(cell, f'{cell[:-1]} style="text-align: {wrapped}">')
    return [("What each command makes of it", html)]


def uses_json(use: Use) -> dict[str, str]:
    return {"usable": use.verdict, "why": use.reason, "instead": use.instead}


def quality_tables(file: str, q: Quality) -> list[Table]:
    """Tables of the channels, of the excited bands, and of the uses for which the recording is good enough."""
    dropped = f", {q.transient_periods} of transient dropped" if q.transient_periods else ""
    channels = Table("channel", "rms", "crest", "step / rms", "signal / noise, median", "worst line")
    channels.title = f"{file}: {q.periods} steady periods{dropped}" if q.periods else f"{file}: nothing repeats"
    for c in q.channels:
        snr = ["-" if v is None else f"{v:.3g}" for v in (c.snr_median, c.snr_worst)]
        channels.add_row(c.name, f"{c.rms:.3g}", f"{c.crest:.2f}", f"{c.resolution_share:.1e}", *snr)
    bands = Table("band, Hz", "displacement / noise", "coherence", "verdict")
    for b in q.bands:
        bands.add_row(f"{b.f_lo:.4g} .. {b.f_hi:.4g}", f"{b.snr:.3g}", f"{b.coherence:.4f}", b.verdict)
    uses = Table("good for", "")
    for use, verdict in ((use, verdict) for use, verdict in q.can.items() if use not in COMMANDS):
        uses.add_row(use, verdict, style=None if verdict.startswith("yes") else "yellow")
    return [channels, *([bands] if q.bands else []), *([uses] if uses.row_count else [])]


def spoiled(q: Quality, name: str, warnings: Sequence[dict[str, Any]]) -> Quality:
    """The quality of a recording that a warning contradicts: it is good for nothing until that is mended."""
    own = [w for w in warnings if w["kind"] == "contradiction" and w["recording"] in (name, name.partition(", ")[0])]
    if not own or q.alarms:
        return q
    why = f"no: {own[0]['code']}, {own[0]['channel']}"
    bands = tuple(replace(b, verdict=own[0]["code"]) for b in q.bands)
    return replace(q, can=dict.fromkeys(q.can, why), bands=bands)


def problem_data(name: str, problem: str) -> dict[str, Any]:
    """A problem of quality as one of the `warnings`."""
    return {"code": "quality", "recording": name, "channel": problem.partition(":")[0] if ":" in problem else "",
            "value": None, "interval": None, "message": problem, "kind": "quality"}  # fmt: skip
