"""The next recording, or the gains to keep: in words, and as TOML to paste."""

from dataclasses import asdict, fields
from pathlib import Path
from textwrap import wrap

from maglev_env.channels import ANALYSED
from maglev_env.loop.gains import Gains, unit_of_gain
from maglev_env.recordings.campaign import Campaign
from maglev_env.recordings.campaign_tables import ChannelSource
from maglev_env.recordings.campaign_writer import excitation_table, toml_table, toml_value
from maglev_env.rig.excitation import UNITS, Excitation
from tuning.campaign.advice import Advice

LINE = 120
_FORMATS = (".mat", ".csv", ".npz", ".h5", ".nc")


def in_words(advice: Advice, gains: Gains) -> str:
    """The gains as text in SI; those that are tuned come first."""
    names = (*advice.task.box.names, *(n for n in asdict(gains) if n not in advice.task.box.names))
    return ", ".join(f"{name} = {digits(getattr(gains, name))} {unit_of_gain(name, names)}".strip() for name in names)


def digits(value: float) -> str:
    """A gain with four significant digits, without an exponent as long as it is readable."""
    return f"{float(f'{value:.4g}'):g}"


def summary(advice: Advice) -> str:
    """Sentences on what to do, why, the uncertainty, and the limitation of the step."""
    if advice.stop:
        text = f"STOP: {advice.stop}."
        if advice.keep is not None:
            p = advice.claimed[advice.keep]
            text += f" Keep {in_words(advice, advice.sets[advice.keep].gains)}"
            text += f": score {p.score.value:.3f}, 95 % {p.score.low:.3f} .. {p.score.high:.3f}."
            text += standing_in_words(advice)
        elif advice.sets:
            text += " None of the gains recorded is to be kept as it stands."
        return text
    text = f"Record next {in_words(advice, advice.next)}: {advice.why}."
    if advice.prediction:
        peak = advice.prediction.peak
        text += f" Peak |S| there {peak.low:.2f} .. {peak.high:.2f} (95 %)."
    if advice.limited and advice.kind == "climb" and advice.share:
        text += f" This is {advice.share:.0%} of the way to the optimum: farther on, {advice.limited}."
    return text


def standing_in_words(advice: Advice) -> str:
    """How the gains to keep stand to the requirements of the goal; nothing for `match`."""
    p, goal = advice.claimed[advice.keep], advice.task.layout.goal
    if p.met is None or goal is None:
        return ""
    if p.missed:
        return f" Requirements not met: {', '.join(p.missed)}."
    unsure = f"; {', '.join(p.unsure)} may not be, within their intervals" if p.unsure else ""
    if p.simulated:
        only = f"; {', '.join(p.simulated)} in simulation only, far beyond the recorded currents"
        return f" Every requirement that the recordings show is met{only}{unsure}."
    return f" Every requirement is met{unsure}."


def excitations_of(advice: Advice) -> tuple[Excitation, ...]:
    """Those of the proposed recording: of a diagnosing one its own, otherwise the rig's."""
    return advice.excitations or advice.task.rig.protocol.excitations


def excitation_words(advice: Advice) -> list[str]:
    """The excitations to use as text."""
    p = advice.task.rig.protocol
    found = [
        f"{e.kind} at the {e.at}, {len(e.lines)} lines from {e.frequencies[0]:g} to {e.frequencies[-1]:g} Hz, peak "
        f"{e.amplitude:g} {UNITS[e.at]}"
        for e in excitations_of(advice)
    ]
    return [*found, f"{p.periods + p.transient_periods} periods"]


def commented(advice: Advice, block: str) -> str:
    """The TOML block as a file, with comments that explain it."""
    return "".join(f"# {line}\n" for line in wrap(summary(advice), LINE - 2)) + "\n" + block


def toml_block(advice: Advice, campaign: Campaign | None) -> str:
    """The [[recording]] to paste into campaign.toml once it is recorded; after a stop the [gains] of a rig file."""
    if advice.stop:
        keep = None if advice.keep is None else advice.sets[advice.keep].gains
        return "\n".join(toml_table("[gains]", asdict(keep))[1:]) + "\n" if keep else ""
    last = campaign.recordings[-1] if campaign else None
    protocol, rate = advice.task.rig.protocol, last.sample_rate if last else advice.task.rig.control_rate
    head = {"file": _file(campaign), "role": "fit", "sample_rate": rate, "start": 0}
    stated = last.intersample if last else "zoh"
    head |= {"intersample": stated} if stated else {}
    head |= {"speed_rpm": last.speed_rpm} if last and last.speed_rpm else {}
    if last and last.layout:
        head["format"] = {key: value for key, value in asdict(last.layout).items() if value is not None}
    lines = toml_table("[[recording]]", head)[1:]
    lines += toml_table("[recording.gains]", asdict(advice.next))
    for e in excitations_of(advice):
        lines += toml_table(
            "[[recording.excitation]]",
            {**excitation_table(e), "periods": protocol.periods + protocol.transient_periods},
        )
    names = {name: ChannelSource((name,), (1.0,)) for name in ANALYSED}
    channels = last.channels if last else names
    return "\n".join([*lines, "", "[recording.channels]", *(_channel(n, c) for n, c in channels.items())]) + "\n"


def _file(campaign: Campaign | None) -> str:
    """An unused file name for a recording, in the format of the last one."""
    if campaign is None:
        return "run1.mat"
    ending = Path(campaign.recordings[-1].file).suffix
    number = len(campaign.recordings) + 1
    while any((campaign.folder / f"run{number}{e}").exists() for e in {ending, *_FORMATS}):
        number += 1
    return f"run{number}{ending}"


def _channel(name: str, source: ChannelSource) -> str:
    one = len(source.columns) == 1
    parts = [f"from = {toml_value(source.columns[0] if one else list(source.columns))}"]
    if not one or source.weights != (1.0,):
        parts.append(f"weights = {toml_value(list(source.weights))}")
    usual = ChannelSource(source.columns, source.weights)
    parts += [
        f"{field.name} = {toml_value(list(v) if isinstance(v, tuple) else v)}"
        for field in fields(source)[2:]
        if (v := getattr(source, field.name)) != getattr(usual, field.name)
    ]
    return f"{name} = {{ {', '.join(parts)} }}"
