"""Gaps found in recordings: console table and lines, page and JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.recordings.formats.json_data import plain
from maglev_env.rig.rig import Rig
from maglev_workbench.commands.selfsense.estimate.figures import gap_figure, ripple_figure
from maglev_workbench.commands.selfsense.estimate.recorded_coils import SensedCoil
from maglev_workbench.commands.selfsense.rig_sensor import made_by
from maglev_workbench.page import note, number, page, table
from selfsense.validity import AT_END, CLIPPED, CONVERGING, LOST, NO_RIPPLE, WRONG_READING

if TYPE_CHECKING:
    import rich.table

_HEAD = ("recording", "samples", "PWM\nkHz", "valid\n%", "mean gap\nµm", "rms\nµm", "error\nµm rms", "mean\nerror")
_LINES, _ROWS = 5, 12  # stretches listed on the console and in the page
_WHY = {
    CONVERGING: "the estimator has started, or is recovering, and not settled",
    NO_RIPPLE: "too little ripple in the current to carry a gap: a duty near 0 or 1, or an open coil",
    AT_END: "the estimate rests on an end of the range that the estimator may search",
    CLIPPED: "the current was at the end of its converter's range",
    WRONG_READING: "a single reading of current or voltage fits no other: a lost or disturbed sample",
    LOST: "nothing is in the file, or no number: the signals are bridged there",
}


def estimate_table(rig: Rig, coils: Sequence[SensedCoil]) -> "rich.table.Table":
    """The recordings in 80 columns."""
    from rich import box
    from rich.table import Table

    result = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title=f"Gap by the coils of {rig.name}")
    for name in _HEAD:
        result.add_column(name, justify="left" if name == "recording" else "right")
    for coil in coils:
        result.add_row(*_row(coil))
    if any(c.comparison for c in coils):
        result.caption = "Error: estimated less recorded gap (at rest less displacement), lag counted."
    return result


def stretch_lines(coil: SensedCoil) -> list[str]:
    """Lines for the console on the parts without a valid gap and on suspicious data."""
    rows = _stretches(coil)
    shares = ", ".join(f"{reason} {share:.2%}" for reason, share in _shares(coil).items())
    lines = [f"{coil.coil.name}: no gap in {1 - coil.valid_share:.2%} of the samples ({shares})"] if rows else []
    lines += [f"{coil.coil.name}: {start} to {stop} ms: {reason}" for start, stop, _, reason in rows[:_LINES]]
    if len(rows) > _LINES:
        lines.append(f"{coil.coil.name}: {len(rows) - _LINES} more stretches are in the page")
    return [*lines, *(f"{coil.coil.name}: note: {text}" for text in coil.notes)]


def estimate_summary(rig: Rig, coils: Sequence[SensedCoil]) -> str:
    """The result in one or two sentences."""
    first = coils[0]
    if len(coils) > 1:
        shares = [100 * c.valid_share for c in coils]
        return (
            f"{len(coils)} coils: {min(shares):.2f} to {max(shares):.2f} % of their samples carry a gap, by "
            f"the coil of {rig.name}."
        )
    text = (
        f"{100 * first.valid_share:.2f} % of the {first.gap.time.size} samples carry a gap, by {rig.name}'s coil: "
        f"{1e6 * np.nanmean(first.gap.gap):.1f} µm on average, {_um(np.nanstd(first.gap.gap))} µm rms about that"
    )
    c = first.comparison
    if c is None:
        return f"{text}."
    return (
        f"{text}. Against the recorded displacement it is wrong by {_um(c.rms)} µm rms, lag counted, and by "
        f"{_um(c.bias)} µm on average; its gain is {c.gain:.4f}."
    )


def estimate_json(
    rig: Rig, coils: Sequence[SensedCoil], settings: Mapping[str, object], files: Sequence[Path], notes: Sequence[str]
) -> dict[str, Any]:
    """The recordings as JSON data, schema maglev-selfsense-estimate/1, SI; samples are counted from the first used.

    The sensor has the coil's constants, to which a gap is proportional; `notes` say what was assumed of all recordings.
    """
    return plain(
        {
            "schema": "maglev-selfsense-estimate/1",
            "version": version("maglev-workbench"),
            "rig": rig.name,
            "settings": settings,
            "notes": notes,
            "recordings": [_one_json(*one) for one in zip(coils, files, strict=True)],
        }
    )


def estimate_page(rig: Rig, coils: Sequence[SensedCoil], settings: Mapping[str, object], notes: Sequence[str]) -> str:
    """The HTML of the recordings; notes say what was assumed of all of them."""
    text = "Valid: samples whose gap can be trusted; the others are left out, not guessed. rms: about the mean. "
    if any(c.comparison for c in coils):
        text += (
            "Error: estimated gap less the recorded one, which is the rig's gap at rest less the displacement; the "
            "estimate's lag counts as error."
        )
    sections: list = [("Recordings", table(_HEAD, map(_row, coils))), ("", note(text))]
    sections += [("", note(f"Note: {words}.")) for words in notes]
    for coil in coils:
        sections += _sections(coil)
    e, rate = coils[0].sensor.estimator, coils[0].coil.spec.sample_rate
    gains = f"kp {e.kp:.4g} m/A, ki {e.ki:.4g} m/(A s), made for this rate"
    facts = {
        **made_by(rig, coils[0].sensor),
        "Coil current": f"as recorded at {rate / 1e3:g} kHz",
        "Estimator": f"{'analog' if e.path.rms else 'digital'} path, {gains}",
        "Source": settings["source"],
        "Switching voltage": "mean since the sample before" if settings["voltage_sampling"] == "mean" else "instants",
    }
    return page(f"Gap from coil currents, {rig.name}", estimate_summary(rig, coils), sections, facts)


def _sections(coil: SensedCoil) -> list:
    name = coil.coil.name
    text = "Shaded: no gap, see the table below. Amplitude: of the ripple behind the forward path; it carries the gap. "
    if coil.comparison is not None:
        c = coil.comparison
        text += (
            f"Estimated less rest = {c.gain:.4f} (recorded less rest) {'+' if c.offset >= 0 else '-'} "
            f"{_um(abs(c.offset))} µm. "
        )
    text += "".join(f"Note: {words}. " for words in coil.notes)
    sections = [(f"{name}: gap", gap_figure(coil)), ("", note(text))]
    rows, shares = _stretches(coil), _shares(coil)
    if rows:
        sections.append(("", table(("from, ms", "to, ms", "samples", "no gap"), rows[:_ROWS])))
        more = f"{len(rows) - _ROWS} more stretches are in the JSON file of --json. " if len(rows) > _ROWS else ""
        why = "; ".join(f"{reason}, {share:.2%} of the samples: {_WHY[reason]}" for reason, share in shares.items())
        overlap = " Stretches may overlap." if len(shares) > 1 else ""
        sections.append(("", note(f"{more}{why[:1].upper()}{why[1:]}.{overlap}")))
    sections.append((f"{name}: ripple of the current", ripple_figure(coil)))
    text = "A few PWM periods in the middle of the longest valid stretch. The current must rise and fall with the "
    sections.append(("", note(f"{text}voltage; the steeper, the wider the gap.")))
    return sections


def _row(coil: SensedCoil) -> tuple[str, ...]:
    gap, c = coil.gap, coil.comparison
    head = (coil.coil.name, str(gap.time.size), f"{gap.pwm_frequency / 1e3:.5g}", f"{100 * coil.valid_share:.2f}")
    error = ("–", "–") if c is None else (_um(c.rms), _um(c.bias))
    return (*head, f"{1e6 * np.nanmean(gap.gap):.2f}", _um(np.nanstd(gap.gap)), *error)


def _stretches(coil: SensedCoil) -> list[tuple[str, str, str, str]]:
    """From and to (ms), samples and reason of each stretch without a gap."""
    rate = coil.coil.spec.sample_rate
    ends = [(s, 1e3 * s.start / rate, 1e3 * s.stop / rate) for s in coil.gap.reasons]
    return [(f"{a:.3f}", f"{b:.3f}", str(s.stop - s.start), s.reason) for s, a, b in ends]


def _shares(coil: SensedCoil) -> dict[str, float]:
    """Share of the samples that each reason makes invalid."""
    found: dict[str, int] = {}
    for s in coil.gap.reasons:
        found[s.reason] = found.get(s.reason, 0) + s.stop - s.start
    return {reason: samples / coil.gap.time.size for reason, samples in found.items()}


def _one_json(coil: SensedCoil, file: Path) -> dict[str, Any]:
    rate, e = coil.coil.spec.sample_rate, coil.sensor.estimator
    return {
        "file": coil.coil.spec.name,
        "axis": coil.coil.suffix.lstrip("_") or None,
        "samples": coil.gap.time.size,
        "sample_rate": rate,
        "pwm_frequency": coil.gap.pwm_frequency,
        "sensor": coil.sensor,
        "kp": e.kp,
        "ki": e.ki,
        "valid_share": coil.valid_share,
        "gap_mean": float(np.nanmean(coil.gap.gap)),
        "gap_rms": float(np.nanstd(coil.gap.gap)),
        "comparison": coil.comparison and asdict(coil.comparison),
        "reasons": _shares(coil),
        "stretches": [{**asdict(s), "from": s.start / rate, "to": s.stop / rate} for s in coil.gap.reasons],
        "notes": coil.notes,
        "estimate": str(file),
    }


def _um(value: float) -> str:
    return number(1e6 * value)
