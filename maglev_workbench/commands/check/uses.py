"""What each command makes of a recording: its own rules are applied, so nothing is said here that it would not say."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from maglev_env.evaluation.identification import Identification
from maglev_env.recordings.alarms.alarm import Alarm
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.left_out import TellsNothing

Verdict = Literal["yes", "with care", "no"]
# What to record where a command cannot use a recording.
INSTEAD = {
    "estimate": "record a force, or an injection with the current and a known mass: an SPHS of at least 5 periods; or "
    "on a named rig the command and displacement at the control rate, with the gains",
    "margins": "inject an SPHS at the current, on the lines between those of the force and up to every crossing of the "
    "loop, and record command and injection",
    "diagnose": "name the rig, state the gains, and record displacement, command and current at the control rate under "
    "an injection, better a force too",
    "tune": "record the rig's [protocol] under PID gains: SPHS at force and current, at least 5 periods, one axis",
}
COMMANDS = tuple(INSTEAD)


@dataclass(frozen=True)
class Use:
    """What one command makes of a recording.

    Attributes:
        command: "estimate", "margins", "diagnose" or "tune".
        verdict: Whether it can be used.
        reason: Why, or what it gives.
        instead: What to record instead; empty where it can be used.
    """

    command: str
    verdict: Verdict
    reason: str
    instead: str


def uses(campaign: Campaign, spec: RecordingSpec, alarms: Sequence[Alarm] = (), refused: str = "") -> tuple[Use, ...]:
    """The verdict of every command on one recording.

    Args:
        campaign: The campaign.
        spec: One of its recordings; its role does not matter.
        alarms: What was wrong while it was recorded: with one, nothing is simply "yes".
        refused: What contradicts the recording, for which every command refuses it; empty: nothing.
    """
    if refused:
        return tuple(Use(name, "no", refused, "mend what is contradicted") for name in COMMANDS)
    alone = replace(campaign, recordings=(replace(spec, role="fit"),))
    rules: dict[str, Callable[[], tuple[Verdict, str]]] = {
        "diagnose": lambda: _diagnose(alone),
        "tune": lambda: _tune(alone),
    }
    try:
        found = _identified(alone)
    except ValueError as error:
        failed = "no", _plain(error, campaign, spec)
        at_rest = isinstance(error, TellsNothing) and _rests(alone, failed[1])
        still = "with care", f"by means and weight alone, where it rests: {failed[1]}"
        rules |= {"estimate": lambda: still if at_rest else failed, "margins": lambda: failed}
    else:
        rules |= {"estimate": lambda: _estimate(found, campaign.mass is None), "margins": lambda: _margins(found)}
    return tuple(_asked(name, rules[name], campaign, spec, alarms) for name in COMMANDS)


def _asked(
    command: str,
    rule: Callable[[], tuple[Verdict, str]],
    campaign: Campaign,
    spec: RecordingSpec,
    alarms: Sequence[Alarm],
) -> Use:
    try:
        verdict, reason = rule()
    except ValueError as error:
        verdict, reason = "no", _plain(error, campaign, spec)
    if verdict == "yes" and alarms:
        verdict, reason = "with care", f"{reason}; {alarms[0].code} at {alarms[0].time:.4g} s"
    return Use(command, verdict, reason, "" if verdict == "yes" else INSTEAD[command])


def _plain(error: ValueError, campaign: Campaign, spec: RecordingSpec) -> str:
    """A command's message without the file, which stands beside it."""
    text = str(error)
    for where in (campaign.folder / spec.file, campaign.folder / spec.name, campaign.folder / "campaign.toml"):
        text = text.removeprefix(f"{where}: ")
    return text


def _identified(alone: Campaign) -> list[Identification]:
    """The identifications of `maglev estimate`; empty for a record that never repeats, which it fits as a whole."""
    from maglev_workbench.commands.estimate.recordings import identify_campaign
    from sim2real.recorded.records import read_records

    if alone.rig is not None and all(e.kind == "none" for e in alone.recordings[0].excitations):
        read_records(alone)  # refuses what the fit of the rig could not use
        return []
    found = identify_campaign(alone, alone.mass is None, None, None, lambda specs: specs, fitted=False)
    return [one for _, one in found.axes]


def _rests(alone: Campaign, why: str) -> bool:
    """Whether `maglev estimate` would use the means of a recording whose motion tells nothing."""
    from sim2real.rest_alone import rest_alone

    return alone.rig is not None and rest_alone(alone, why) is not None


def _estimate(found: Sequence[Identification], unweighed: bool) -> tuple[Verdict, str]:
    from maglev_workbench.commands.estimate.answer import trusted

    if not found:
        return "yes", "in closed loop: the rig is fitted to what drove it"
    sure = [band for one in found for band in trusted(one.bands)]
    if not sure:
        return "no", "no band bounds stiffness and damping: raise the force, or record longer"
    low, high = min(b.f_lo for b in sure), max(b.f_hi for b in sure)
    text = f"stiffness and damping from {low:.4g} to {high:.4g} Hz"
    if unweighed:
        return "with care", f"{text}, with --estimate-mass: the mass is not stated"
    return "yes", text


def _margins(found: Sequence[Identification]) -> tuple[Verdict, str]:
    if not found:
        return "no", "nothing is stated that was injected: margins are measured between injection and command"
    stability = next((one.stability for one in found if one.stability), None)
    if stability is None:
        return "no", next((note for one in found for note in one.notes if "margins" in note), "nothing is injected")
    if stability.source != "injection":
        return "with care", f"{stability.source}: no injection at the current is recorded"
    if (why := stability.margins.reasons.get("peak_sensitivity")) is not None:
        return "with care", why
    return "yes", "measured between injection and command"


def _diagnose(alone: Campaign) -> tuple[Verdict, str]:
    from sim2real.compared.problem import assemble
    from sim2real.recorded.open_record import OpenRecord
    from sim2real.recorded.records import read_records

    loaded, records = read_records(alone)
    if any(isinstance(r, OpenRecord) and r.upstream for r in records):
        return "with care", "the current drives the simulation: nothing before it shows, and what follows is one block"
    channels = assemble(records).parts[0].opened.outputs
    if "amplifier" in channels or not loaded.rig.controlled:
        return "yes", "blocks can be told apart"
    return "with care", "without the current, controller, amplifier, actuator and mechanics cannot be told apart"


def _tune(alone: Campaign) -> tuple[Verdict, str]:
    from maglev_env.task.gain_box import TUNED
    from tuning.campaign.next_step import tuning_task
    from tuning.campaign.recorded_sets import recorded_sets

    if alone.rig is None:
        return "no", "rig is missing; tuning needs the nominal rig"
    if alone.rig.axes != 1:
        return "no", "the rig has two axes, and a campaign is tuned one axis at a time"
    _, (found,) = recorded_sets(alone)
    tuning_task(alone.rig, [found], TUNED)
    if found.failed:
        return "no", found.failed
    if found.untold:
        return "with care", f"it does not tell the margins: {found.untold}; the designed recording is proposed"
    if found.sensitivity is None or found.receptance is None:
        missing = "sensitivity (an injection)" if found.sensitivity is None else "receptance (a force)"
        return "with care", f"its {missing} is not shown, so it has no score"
    return "yes", "loop and receptance are shown"


_STATEMENT = 3  # words of the shortest statement


def check_answer(found: Sequence[tuple[str, Sequence[Use]]], alarmed: int, blocking: Sequence[str] = ()) -> str:
    """One sentence on what the recordings are usable for, and one on what must be mended before.

    Args:
        found: File and uses of each.
        alarmed: How many have alarms.
        blocking: Files whose contradiction makes the commands refuse all of the campaign.
    """
    total = len(found)
    able: dict[Verdict, list[str]] = {"yes": [], "with care": []}
    refused: dict[str, list[str]] = {}  # the reason in short -> the commands
    for i, command in enumerate(COMMANDS):
        own = [uses[i] for _, uses in found]
        usable = sum(use.verdict != "no" for use in own)
        if usable:
            best: Verdict = "yes" if any(use.verdict == "yes" for use in own) else "with care"
            able[best].append(command + (f" ({usable} of {total})" if total > 1 else ""))
        else:
            reason = re.sub(r"^rig [^:;]+: ", "", own[0].reason)  # whose rule it is says nothing in short
            refused.setdefault(_in_short(reason), []).append(command)
    good = [f"for {_and(able['yes'])}"] if able["yes"] else []
    good += [f"with care for {_and(able['with care'])}"] if able["with care"] else []
    bad = "for " + ", ".join(f"{_and(commands)} ({why})" for why, commands in refused.items()) if refused else ""
    head = f"Usable {', '.join(good)}{'; not ' * bool(bad)}{bad}" if good else f"Not usable {bad}"
    head += f"; {alarmed} of {total} recording(s) with an alarm." if alarmed else "."
    if good and blocking:
        head += f" First mend or take out {', '.join(blocking)}: a contradicted recording makes every command refuse."
    return head


def _in_short(reason: str) -> str:
    """The first statement of a reason; what stands before a colon is none where it names the channel alone."""
    first = re.split("; ", reason)[0]
    head = first.partition(": ")[0]
    return head if len(head.split()) >= _STATEMENT else first


def _and(words: Sequence[str]) -> str:
    return " and ".join(part for part in (", ".join(words[:-1]), words[-1]) if part)
