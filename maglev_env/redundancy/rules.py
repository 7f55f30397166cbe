"""The registry of rules, and their application to a campaign."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from maglev_env.loop.axes import AXES
from maglev_env.loop.gains import of_axis
from maglev_env.recordings.alarms import alarms_of
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.redundancy.amplifier import amplified
from maglev_env.redundancy.bounds import clearance, sensitivity
from maglev_env.redundancy.cause import explained
from maglev_env.redundancy.controller import controlled, stated_gains
from maglev_env.redundancy.coverage import uncovered
from maglev_env.redundancy.design import dead_lines, designed
from maglev_env.redundancy.finding import ORDER, Finding
from maglev_env.redundancy.newton import moved
from maglev_env.redundancy.periods import breaks, drifts, jumps, outliers
from maglev_env.redundancy.rows import Row
from maglev_env.redundancy.view import View
from maglev_env.rig.rig import axis_rig

# Comparisons of channels. Each gives rows, which are explained together; see `cause`.
ROWS: Mapping[str, Callable[[View], list[Row]]] = {
    "designed waveform": designed,
    "controller": controlled,
    "amplifier": amplified,
    "Newton's law": moved,
}
# Rules that stand by themselves.
RULES: Mapping[str, Callable[[View], list[Finding]]] = {
    "clearance": clearance,
    "lines": dead_lines,
    "missing samples": jumps,
    "breaks": breaks,
    "spikes": outliers,
    "drift": drifts,
    "sensitivity": sensitivity,
    "gains": stated_gains,
}
FINAL = ("clearance", "lines", "missing samples", "gains")  # rows would only repeat in other words what these found


def examine(campaign: Campaign) -> list[Finding]:
    """All findings of a campaign, the most serious first.

    Raises:
        ValueError, OSError: As `read_recording`.
    """
    found = [finding for spec in campaign.recordings for finding in examine_recording(campaign, spec)]
    return sorted(found, key=lambda f: ORDER.index(f.kind))


def examine_recording(campaign: Campaign, spec: RecordingSpec) -> list[Finding]:
    """The findings of one recording: its alarms, then those of the rules."""
    dataset = read_recording(campaign, spec, alarmed=True)
    found = [
        Finding(a.code, spec.file, a.channel, a.time, None, f"{a.channel}: {a.sentence}",
                "contradiction" if a.severity == "refuse" else "quality")
        for a in alarms_of(dataset)
    ]  # fmt: skip
    if any(f.kind == "contradiction" for f in found):
        return found
    signals = recorded_signals(campaign, spec, dataset, excited=False)
    views = _views(campaign, spec, signals)
    for view in views:
        found += _findings(view)
    if any(f.code in ("mismatch", "controller") for f in found):
        found = _swapped(campaign, spec, signals) or _other_rate(views) or found
    return found


def _findings(view: View) -> list[Finding]:
    found = [finding for rule in RULES.values() for finding in rule(view)]
    if not any(f.code in FINAL and f.kind != "quality" for f in found):
        rows = comparisons(view)
        found += explained(view, rows)
        found += uncovered(view, rows)
    return found


def comparisons(view: View) -> list[Row]:
    """The rows of one axis."""
    return [row for rule in ROWS.values() for row in rule(view)]


def _views(campaign: Campaign, spec: RecordingSpec, signals: RecordedSignals) -> list[View]:
    views = []
    for axis in range(signals.axes):
        own = axis_signals(signals, axis)
        moving = own.excitations or all(e.kind == "none" for e in spec.excitations)
        if not moving:
            continue
        which = own.axis if own.axis is not None else 0
        suffix = f"_{AXES[which]}" if own.axis is not None else ""
        rig = campaign.rig and axis_rig(campaign.rig, which)
        controllers = [r.gains for r in campaign.recordings if r.gains is not None and r.gains != spec.gains]
        recorded = {name.removesuffix(suffix) if suffix else name: name for name in spec.channels}
        mass = rig.mass if rig is not None and campaign.mass == campaign.rig.mass else campaign.mass
        name = spec.file if not suffix else f"{spec.file}, {AXES[which]}"
        views.append(
            View(
                name, own.sample_rate, own.channels, frozenset(recorded) & frozenset(own.channels),
                {k: " + ".join(spec.channels[v].columns) for k, v in recorded.items()},
                own.excitations, frozenset(e.at for e in spec.excitations if e.amplitude != 1.0),
                spec.gains and of_axis(spec.gains, which),
                tuple(dict.fromkeys(of_axis(c, which) for c in controllers)), rig, mass, own.hold_rate, own.left_out,
            ).at_control_rate()
        )  # fmt: skip
    return views


def _swapped(campaign: Campaign, spec: RecordingSpec, signals: RecordedSignals) -> list[Finding]:
    """Two columns exchanged: the one exchange under which every comparison agrees."""
    names = [n for n in signals.channels if n in spec.channels]
    found = []
    for one, other in combinations(names, 2):
        changed = {**signals.channels, one: signals.channels[other], other: signals.channels[one]}
        views = _views(campaign, spec, replace(signals, channels=changed))
        rows = [row for view in views for row in comparisons(view)]
        if rows and not any(row.off for row in rows):
            found.append((one, other))
    if not found:
        return []
    one, other = found[0]
    text = (
        f"{one} and {other}: their columns ({_column(spec, one)!r} and {_column(spec, other)!r}) are exchanged: the other "
        "way round every comparison agrees; correct [recording.channels]"
    )
    return [Finding("swapped", spec.file, f"{one} or {other}", None, None, text, "contradiction")]


def _column(spec: RecordingSpec, name: str) -> str:
    return " + ".join(spec.channels[name].columns)


def _other_rate(views: Iterable[View]) -> list[Finding]:
    """A recording that never repeats whose comparisons agree at another rate."""
    for view in views:
        if view.periodic or view.rig is None:
            continue
        for factor in (0.25, 0.5, 2.0, 4.0):
            rows = comparisons(replace(view, rate=view.rate * factor))
            if rows and not any(row.off for row in rows):
                text = f"time: every comparison agrees at {view.rate * factor:g} Hz; check sample_rate = {view.rate:g} Hz"
                return [Finding("rate", view.recording, "time", factor, None, text, "contradiction")]
    return []


def refusals(found: Iterable[Finding]) -> list[Finding]:
    """Those because of which nothing is identified."""
    return [f for f in found if f.kind == "contradiction"]


def as_data(found: Iterable[Finding]) -> list[dict]:
    """Findings as JSON data: `warnings`."""
    return [
        {
            "code": f.code, "recording": f.recording, "channel": f.channel,
            "value": None if f.value is None or not np.isfinite(f.value) else f.value,
            "interval": None if f.interval is None or not np.isfinite(f.interval).all() else list(f.interval),
            "message": f.message, "kind": f.kind,
        }
        for f in found
    ]  # fmt: skip
