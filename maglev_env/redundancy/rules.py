"""The registry of rules, and their application to a campaign."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.loop.axes import AXES
from maglev_env.loop.gains import of_axis
from maglev_env.recordings.alarms.alarm import alarms_of
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.redundancy.alike import alike
from maglev_env.redundancy.amplifier import amplified, unrelated, unstated_pole
from maglev_env.redundancy.bounds import balance, clearance, rails, ranges, reversed_coils, sensitivity, still
from maglev_env.redundancy.changes import clocks, copied, copies, ranges_changed
from maglev_env.redundancy.controller import controlled, stated_gains
from maglev_env.redundancy.coupling import coupled, decoupled, slow_parts
from maglev_env.redundancy.coverage import uncovered
from maglev_env.redundancy.design import dead_lines, designed
from maglev_env.redundancy.explained import explained, or_effect
from maglev_env.redundancy.finding import ORDER, Finding
from maglev_env.redundancy.newton import moved
from maglev_env.redundancy.own_clocks import other_clocks
from maglev_env.redundancy.periods import breaks, drifts, jumps, outliers
from maglev_env.redundancy.resistance import ohm
from maglev_env.redundancy.reversed_columns import reversed_columns
from maglev_env.redundancy.rows import Row
from maglev_env.redundancy.single_samples import single_samples
from maglev_env.redundancy.turned import DOUBTED, turned
from maglev_env.redundancy.units import unscaled
from maglev_env.redundancy.view import View
from maglev_env.rig.rig import axis_rig, with_parameters

if TYPE_CHECKING:
    import xarray as xr

# Comparisons of channels. Each gives rows, which are explained together; see `explained`.
ROWS: Mapping[str, Callable[[View], list[Row]]] = {
    "designed waveform": designed,
    "controller": controlled,
    "amplifier": amplified,
    "Newton's law": moved,
}
# Rules that stand by themselves.
RULES: Mapping[str, Callable[[View], list[Finding]]] = {
    "clearance": clearance,
    "noise": still,
    "range": ranges,
    "bias": reversed_coils,
    "alike": alike,
    "copies": copies,
    "range change": ranges_changed,
    "clocks": clocks,
    "missing samples": jumps,
    "lines": dead_lines,
    "gains": stated_gains,
    "breaks": breaks,
    "AC coupling": coupled,
    "balance": balance,
    "spikes": outliers,
    "single samples": single_samples,
    "drift": drifts,
    "sensitivity": sensitivity,
    "rail": rails,
    "unrelated": unrelated,
    "unstated": unstated_pole,
}
# What exchanged columns or a wrong rate can look like.
DOUBTFUL = ("mismatch", "controller", "lines", "scale", "sign", "filter", "shape", "clearance", "sensitivity", "delay")
FINAL = (
    "clearance",
    "range",
    "lines",
    "missing samples",
    "gains",
    "identical",
)  # others would only repeat in other words what these found
TIMED = ("controller", "newton")  # comparisons that depend on the rate
CHANGED = ("range change", "clock")  # a mean over the periods says nothing then


def examine(campaign: Campaign) -> list[Finding]:
    """All findings of a campaign, the most serious first.

    Raises:
        ValueError, OSError: As `read_recording`.
    """
    found = [finding for spec in campaign.recordings for finding in examine_recording(campaign, spec)]
    return sorted(found, key=lambda f: ORDER.index(f.kind))


def examine_recording(campaign: Campaign, spec: RecordingSpec) -> list[Finding]:
    """The findings of one recording: its alarms, then those of the rules."""
    dataset = read_recording(campaign, spec, alarmed=True, unexcited=True)
    alarms = [
        Finding(a.code, spec.name, a.channel, a.time, None, a.sentence,
                "contradiction" if a.severity == "refuse" else "quality")
        for a in alarms_of(dataset)
    ]  # fmt: skip
    whole = {str(name): dataset[name].values for name in dataset.data_vars}
    alarms += [*unscaled(campaign, spec), *other_clocks(campaign, spec), *ohm(campaign, spec, whole)]
    if not any(name.startswith("displacement") for name in spec.channels):
        return alarms
    signals = recorded_signals(campaign, spec, _at_ticks(spec, dataset), excited=False)
    views = _views(campaign, spec, signals)
    if any(f.kind == "contradiction" for f in alarms):
        # A wrong scale also seems to reach the end of a range.
        of_range = [f for view in views for rule in (clearance, ranges) for f in rule(view)]
        return [*(f for f in of_range if f.kind == "contradiction"), *alarms]
    across = turned(spec, _of_all_lines(campaign, spec, signals))
    if across and across[0].kind != "not checkable":  # it bends every comparison of one axis
        own = [f for view in views for rule in RULES.values() for f in rule(view) if f.code not in DOUBTED]
        return [*across, *alarms, *own]
    found = [*across, *(f for view in views for f in _findings(view))]
    if any(f.code in DOUBTFUL and f.kind in ("contradiction", "wiring") for f in found) or not all(
        view.rig is None or view.rate == view.rig.control_rate for view in views
    ):
        found = _other_rate(campaign, spec, signals) or found
    doubtful = [f for f in found if f.code in (*DOUBTFUL, "amplifier") and f.kind != "quality"]
    if doubtful:
        found = _swapped(campaign, spec, views, all(f.kind == "effect" for f in doubtful)) or found
    if any(f.code in ("controller", "mismatch") for f in found):
        before = _of_all(views)
        found = reversed_columns(spec, lambda other, names: bool(_if_meant(campaign, other, before, names))) or found
    return [*alarms, *found]


def _of_all(views: Iterable[View]) -> list[Row]:
    return [row for view in views for row in comparisons(view)]


def _if_meant(
    campaign: Campaign, changed: RecordingSpec, before: Sequence[Row], names: Sequence[str], effects: bool = False
) -> list[Row]:
    """The comparisons of a changed recording if all agree; none where it is not what was meant.

    They must be no fewer than before, and one of them of the channels that changed. With `effects` one may be off as an
    effect makes it.
    """
    try:
        signals = recorded_signals(campaign, changed, read_recording(campaign, changed), excited=False)
        views = _views(campaign, changed, signals)
    except ValueError:
        return []
    rows = _agreeing(views, effects)
    return rows if _as_many(rows, before) and _compares(rows, *names) else []


def _at_ticks(spec: RecordingSpec, dataset: "xr.Dataset") -> "xr.Dataset":
    """A resampled recording without a period as it was read at its own ticks, at which the controller ran."""
    ticks = {name: f"tick_{name}" for name in map(str, dataset.data_vars)}
    whole = "masked" not in dataset.coords and not any(e.periodic for e in spec.excitations)
    if not whole or not all(tick in dataset.coords for tick in ticks.values()):
        return dataset
    read = {name: ("time", dataset[tick].values, dataset[name].attrs) for name, tick in ticks.items()}
    return type(dataset)(read, attrs=dataset.attrs)


def _findings(view: View) -> list[Finding]:
    found: list[Finding] = []
    for rule in RULES.values():
        found += rule(view)
        if any((f.code in FINAL and f.kind == "contradiction") or f.code in CHANGED for f in found):
            return found
    rows = list(comparisons(view))
    # What a coupling bends is no other matter; what differs without it is, and no coupling of one channel explains it.
    coupling = next((f for f in found if f.code == "filter" and f.kind == "wiring"), None)
    if coupling is not None:
        whole = decoupled(view, coupling)
        rest = list(comparisons(whole))
        if any(row.shape_off and row.lag and coupling.channel.partition(" or ")[0] in row.powers for row in rest):
            found, coupling = [f for f in found if f is not coupling], None  # it was the bend of a low-pass
    why = explained(view, rows) if coupling is None else explained(whole, rest)
    why = why or ([] if coupling else slow_parts(view))
    # A cause that is named explains what the peak of |S| can only doubt.
    named = [f for f in why if f.code in ("scale", "sign") and f.kind == "contradiction"]
    return [*named, *found, *(f for f in why if f not in named), *uncovered(view, rows)]


def comparisons(view: View) -> Iterator[Row]:
    """The rows of one axis. Periods that are copies hide the noise, so that exact relations alone are compared."""
    copies_hide = copied(view)
    for rule in ROWS.values():
        for row in rule(view):
            own = replace(row, misfit=0.0) if copies_hide else row
            if (own.known or own.shape_off) and not (copies_hide and own.gain_effects):
                yield own


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
        mass = campaign.mass
        if rig is not None and mass is not None:  # a given mass replaces the common one; an axis' own keeps its ratio
            rig = with_parameters(rig, {"mass": mass * rig.mass / campaign.rig.mass})
            mass = rig.mass
        name = spec.name if not suffix else f"{spec.name}, {AXES[which]}"
        views.append(
            View(
                name, own.sample_rate, own.channels, frozenset(recorded) & frozenset(own.channels),
                {k: spec.channels[v].expression for k, v in recorded.items()},
                own.excitations, spec.stated_peaks,
                spec.gains and of_axis(spec.gains, which),
                tuple(dict.fromkeys(of_axis(c, which) for c in controllers)), rig, mass, own.hold_rate, own.left_out,
                frozenset(k for k, v in recorded.items() if spec.channels[v].chained),
                own.masked, frozenset(k for k, v in recorded.items() if v in own.railed),
            )
        )  # fmt: skip
    # A coil recorded with its switching voltage ripples: the control samples alone would fold that back.
    return [view if "voltage" in view.channels else view.at_control_rate() for view in views]


def _of_all_lines(campaign: Campaign, spec: RecordingSpec, signals: RecordedSignals) -> list[View]:
    """Both axes with the lines that are excited along any."""
    if signals.axes == 1:
        return []
    everywhere = tuple(replace(e, direction=45.0) for e in signals.excitations)
    return _views(campaign, spec, replace(signals, excitations=everywhere))


def _swapped(campaign: Campaign, spec: RecordingSpec, views: Sequence[View], alike: bool) -> list[Finding]:
    """Two columns exchanged: the one exchange under which all rules agree.

    Of two axes' columns of one quantity it is enough that what still differs is what an effect does, if that is not so
    as they are; of several such exchanges the one under which least differs.

    `alike`: try only such columns, because an effect may explain what differs.
    """
    names = [n for n in spec.channels if n != "time"]
    before = _of_all(views)
    beyond = any(row.off and not or_effect(row) for row in before)
    possible: list[tuple[int, str, str]] = []  # comparisons that still differ, and the columns
    for one, other in combinations(names, 2):
        of_axes = one.partition("_")[0] == other.partition("_")[0]
        if alike and not of_axes:
            continue
        exchanged = replace(spec, channels={**spec.channels, one: spec.channels[other], other: spec.channels[one]})
        if rows := _if_meant(campaign, exchanged, before, (one, other), of_axes and beyond):
            possible.append((sum(row.off for row in rows), one, other))
            if not possible[-1][0]:
                break
    if not possible:
        return []
    left, one, other = min(possible)
    text = (
        f"{one} and {other}: columns {_column(spec, one)!r} and {_column(spec, other)!r} are exchanged: the other way "
        f"round every comparison agrees{' but for what an effect may do' if left else ''}; correct [recording.channels]"
    )
    return [Finding("swapped", spec.name, f"{one} or {other}", None, None, text, "contradiction")]


def _column(spec: RecordingSpec, name: str) -> str:
    return spec.channels[name].expression


def _other_rate(campaign: Campaign, spec: RecordingSpec, signals: RecordedSignals) -> list[Finding]:
    """A recording that never repeats whose comparisons agree at the control rate, which is not the stated one.

    Or one of them agrees there that depends on the rate, by the stated controller or by the mass, and what else does
    not agree may be an effect.
    """
    rig = campaign.rig
    if rig is None or signals.periodic or signals.sample_rate == rig.control_rate:
        return []
    at_rate = _views(campaign, spec, replace(signals, sample_rate=rig.control_rate))
    if any(map(_contradicted, at_rate)):
        return []
    rows = _of_all(at_rate)
    if not _agree(rows) and not _timed(rows):
        return []
    text = (
        f"time: the channels agree at the control rate of {rig.control_rate:g} Hz; check sample_rate = "
        f"{signals.sample_rate:g} Hz and the unit of the time"
    )
    return [Finding("rate", spec.name, "time", signals.sample_rate / rig.control_rate, None, text, "contradiction")]


def _as_many(rows: Iterable[Row], before: Iterable[Row]) -> bool:
    """Whether among comparisons are those that there were before, on as many axes."""
    return Counter(row.code for row in before) <= Counter(row.code for row in rows)


def _agree(rows: Sequence[Row]) -> bool:
    """Whether there are comparisons, and all agree."""
    return bool(rows) and not any(row.off for row in rows)


def _compares(rows: Sequence[Row], *channels: str) -> bool:
    """Whether any of the comparisons is of one of these channels: the others agree whatever is exchanged."""
    return any(name.partition("_")[0] in row.powers for row in rows for name in channels)


def _timed(rows: Sequence[Row]) -> bool:
    """Whether a comparison that depends on the rate agrees, and what does not agree may be an effect."""
    return any(r.code.startswith(TIMED) and not r.off for r in rows) and all(or_effect(r) for r in rows if r.off)


def _agreeing(views: Iterable[View], effects: bool) -> list[Row]:
    """The comparisons of all views; none, without a look at the others, where a rule is contradicted or one is off,
    which with `effects` it may be as an effect makes it."""
    rows = []
    for view in views:
        if _contradicted(view):
            return []
        for row in comparisons(view):
            if row.off and not (effects and or_effect(row)):
                return []
            rows.append(row)
    return rows


def _contradicted(view: View) -> bool:
    return any(f.kind == "contradiction" for rule in RULES.values() for f in rule(view))


def refusals(found: Iterable[Finding]) -> list[Finding]:
    """The findings that are contradictions: nothing is identified from such recordings."""
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
