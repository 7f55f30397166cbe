"""What recordings are good for, and their quality: tables for the terminal, a section of the page, JSON."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rich.table import Table

from maglev_env.channels import CHANNELS
from maglev_env.loop.axes import AXES
from maglev_env.recordings.quality import ChannelQuality, Quality
from maglev_env.units import prefixed
from maglev_workbench.commands.check.uses import COMMANDS, Use
from maglev_workbench.page import table as html_table

_HEAD = ("command", "usable", "why", "record instead")
ALL = "all"


def grouped(found: Sequence[tuple[str, Sequence[Use]]]) -> list[tuple[str, str, Use]]:
    """Every verdict once: the commands and the recordings that it is the same of, and one of them."""
    rows: dict[tuple[str, Use], list[str]] = {}  # recordings, and the verdict without its command -> commands
    for i, command in enumerate(COMMANDS):
        of: dict[Use, list[str]] = {}
        for file, uses in found:
            of.setdefault(replace(uses[i], command=""), []).append(file)
        for use, files in of.items():
            names = ALL if len(files) == len(found) > 1 else ", ".join(files)
            rows.setdefault((names, use), []).append(command)
    return [(", ".join(commands), files, use) for (files, use), commands in rows.items()]


def uses_table(found: Sequence[tuple[str, Sequence[Use]]]) -> Table:
    """What each command makes of the recordings."""
    several = len(found) > 1
    table = Table(*(_HEAD[:1] if not several else (_HEAD[0], "recordings")), *_HEAD[1:])
    for commands, files, use in grouped(found):
        style = {"yes": None, "with care": "yellow", "no": "red"}[use.verdict]
        named = [files] if several else []
        table.add_row(commands, *named, use.verdict, use.reason, use.instead, style=style)
    return table


def uses_sections(found: Sequence[tuple[str, Sequence[Use]]]) -> list[tuple[str, str]]:
    """The same as a section of a page."""
    rows = [(commands, files, use.verdict, use.reason, use.instead) for commands, files, use in grouped(found)]
    html = html_table((_HEAD[0], "recordings", *_HEAD[1:]), rows)
    html = html.replace("<th>", '<th style="text-align: left">')
    html = html.replace("<td>", '<td class="wrapped" style="text-align: left">')
    return [("What each command makes of it", html)]


def uses_json(use: Use) -> dict[str, str]:
    return {"usable": use.verdict, "why": use.reason, "instead": use.instead}


def aperiodic_table(found: Sequence[tuple[str, Quality]]) -> Table:
    """The channels of all recordings in which nothing repeats, so that no noise can be told."""
    table = Table("nothing repeats", "channel", "rms", "crest", "step / rms")
    for name, quality in found:
        for i, c in enumerate(quality.channels):
            table.add_row(name if i == 0 else "", *_shape(c), end_section=i == len(quality.channels) - 1)
    return table


def _shape(c: ChannelQuality) -> tuple[str, ...]:
    known = CHANNELS.get(c.name.partition("_")[0])
    scale, unit = prefixed(c.rms, known.unit) if known else (1.0, "")
    return c.name, f"{c.rms * scale:.3g} {unit}".rstrip(), f"{c.crest:.2f}", f"{c.resolution_share:.1e}"


def quality_tables(file: str, q: Quality) -> list[Table]:
    """Tables of the channels, of the excited bands, and of the uses for which the recording is good enough."""
    tables = []
    if q.periods:
        dropped = f", {q.transient_periods} of transient dropped" if q.transient_periods else ""
        channels = Table("channel", "rms", "crest", "step / rms", "signal / noise, median", "worst line")
        channels.title = f"{file}: {q.periods} steady periods{dropped}" if q.repeats else f"{file}: nothing repeats"
        for c in q.channels:
            snr = ["-" if v is None else f"{v:.3g}" for v in (c.snr_median, c.snr_worst)]
            channels.add_row(*_shape(c), *snr)
        tables.append(channels)
    bands = Table("band, Hz", "displacement / noise", "coherence", "verdict")
    for b in q.bands:
        bands.add_row(f"{b.f_lo:.4g} .. {b.f_hi:.4g}", f"{b.snr:.3g}", f"{b.coherence:.4f}", b.verdict)
    uses = Table("good for", "", title="" if q.periods else file)
    for use, verdict in ((use, verdict) for use, verdict in q.can.items() if use not in COMMANDS):
        uses.add_row(use, verdict, style=None if verdict.startswith("yes") else "yellow")
    return tables + ([bands] if q.bands else []) + ([uses] if uses.row_count else [])


def said_once(notes: Sequence[tuple[str, str]], total: int) -> list[str]:
    """Notes (recording, text), each once, with the names of the recordings where it is not of all."""
    of: dict[str, list[str]] = {}
    for name, text in notes:
        of.setdefault(text, []).append(name)
    return [
        text if len(set(names)) == total else f"{', '.join(dict.fromkeys(names))}: {text}" for text, names in of.items()
    ]


def is_of(recording: str, file: str) -> bool:
    """Whether a finding is of a file, as a whole or along one axis; a file's name may itself hold a comma."""
    return recording in (file, *(f"{file}, {axis}" for axis in AXES))


def spoiled(q: Quality, names: Sequence[str], warnings: Sequence[dict[str, Any]]) -> Quality:
    """The quality of a recording that a warning contradicts: it is good for nothing until that is mended.

    Args:
        q: of the recording along one axis.
        names: of the file, and of the file along that axis.
        warnings: of all recordings.
    """
    own = [w for w in warnings if w["kind"] == "contradiction" and w["recording"] in names]
    if not own or q.alarms:
        return q
    why = f"no: {own[0]['code']}, {own[0]['channel']}"
    bands = tuple(replace(b, verdict=own[0]["code"]) for b in q.bands)
    return replace(q, can=dict.fromkeys(q.can, why), bands=bands)


def problem_data(name: str, problem: str) -> dict[str, Any]:
    """A problem of quality as one of the `warnings`."""
    return {"code": "quality", "recording": name, "channel": problem.partition(":")[0] if ":" in problem else "",
            "value": None, "interval": None, "message": problem, "kind": "quality"}  # fmt: skip
