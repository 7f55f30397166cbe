"""What a recording is good for, and its quality: tables for the terminal, a section of the page, JSON."""

from collections.abc import Sequence

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
