"""The rules of redundancy before every command that reads a campaign: warnings in the first lines, or a refusal."""

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Any, get_args

from rich.text import Text

from maglev_env.recordings.alarms.alarm import Code
from maglev_env.recordings.campaign import Campaign
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.rules import as_data, examine, refusals
from maglev_workbench.console import console, marked

# Findings because of which a command leaves a recording out and uses the others.
LEAVING_OUT = get_args(Code)
_ONCE = ("effect", "quality")  # kinds of which the largest is shown for all recordings: nothing is refused for them
_STYLE = {"contradiction": "bold red", "wiring": "bold yellow", "effect": "yellow", "quality": "yellow"}


def warned(campaign: Campaign, allowed: Collection[str] = (), refuse: bool = True) -> list[dict[str, Any]]:
    """Examine every recording and print what is found.

    Args:
        campaign: With its recordings.
        allowed: Codes that the command itself judges; they do not refuse.
        refuse: False for a command that only shows.

    Returns:
        `warnings` of the command's JSON.

    Raises:
        ValueError: A recording contradicts physics or its own description; the message says how.
    """
    found = examine(campaign)
    if refuse and (worst := refusing(found, allowed)):
        more = f" ({len(worst) - 1} more: `maglev check` shows all)" if len(worst) > 1 else ""
        raise ValueError(f"{campaign.folder / worst[0].recording}: {worst[0].message}{more}")
    return shown(found)


def refusing(found: Iterable[Finding], allowed: Collection[str] = LEAVING_OUT) -> list[Finding]:
    """The findings because of which a command that judges the allowed codes itself refuses all of the campaign."""
    return [f for f in refusals(found) if f.code not in allowed]


def shown(found: Iterable[Finding]) -> list[dict[str, Any]]:
    """Print findings, those of several recordings once, and give them as the `warnings` of a command's JSON."""
    found = list(found)
    of: dict[Finding, list[str]] = {}  # a finding without its recording -> its recordings
    for finding in found:
        of.setdefault(replace(finding, recording=""), []).append(finding.recording)
    alike: dict[Any, list[Finding]] = {}
    for finding, recordings in of.items():
        one = replace(finding, recording=", ".join(dict.fromkeys(recordings)))
        alike.setdefault((one.code, one.channel, one.kind) if one.kind in _ONCE else one, []).append(one)
    for those in alike.values():
        console.print(line(_in_one(those)), soft_wrap=True)
    return as_data(found)


def _in_one(those: list[Finding]) -> Finding:
    """Findings of one rule as one: the largest in full, and where it is likewise."""
    worst = max(those, key=lambda one: abs(one.value or 0.0))
    others = "; ".join(one.recording for one in those if one is not worst)
    return replace(worst, message=f"{worst.message} (likewise, though less: {others})") if others else worst


def line(finding: Finding) -> Text:
    """One finding as a line of the terminal."""
    word = {"contradiction": "ALARM", "not checkable": "note"}.get(finding.kind, "warning")
    style = _STYLE.get(finding.kind, "")
    return marked(word if style else f"  {word}:", f"{finding.recording}: {finding.message}", style)
