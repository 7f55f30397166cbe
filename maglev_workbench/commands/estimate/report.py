"""Reports of `maglev estimate`: JSON, a terminal table per recording, and one page of all recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Literal

from estimation.normal import NORMAL_95
from maglev_env.evaluation.bands import Band
from maglev_env.evaluation.identification import Identification
from maglev_env.evaluation.stability import Stability
from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.estimate.figures import (
    COEFFICIENTS,
    coefficients,
    estimate,
    in_words,
    receptance,
    sensitivity,
    units_of,
)
from maglev_workbench.commands.estimate.gain_report import gain_json, gain_sections
from maglev_workbench.page import facts, html_text, note, number, page, table, with_interval

if TYPE_CHECKING:
    import rich.table
    from plotly.graph_objects import Figure

Method = Literal["ls", "ml", "both"]
# If noise does not dominate a band, and both adjusted R2 and p of the fit are below these limits, constant coefficients
# do not describe the band.
POOR_FIT, MISFIT = 0.9, 1e-3
ROWS = 30  # largest number of bands in a terminal's table
_SHARED = ("f_lo", "f_hi")
_MARGINS = {  # label, factor from SI, unit
    "peak_sensitivity": ("Peak |S|", 1.0, ""),
    "phase_margin": ("Phase margin", 1.0, "°"),
    "gain_margin_low": ("Gain margin down", 1.0, ""),
    "gain_margin_high": ("Gain margin up", 1.0, ""),
    "delay_margin": ("Delay margin", 1e6, "µs"),
    "disk_margin": ("Disk margin", 1.0, ""),
}


def estimate_json(results: Sequence[tuple[str, Identification]], method: Method) -> dict[str, Any]:
    """Recordings as JSON data, schema maglev-estimate/1, SI; missing or unbounded values are None.

    Args:
        results: (file, identification).
        method: "ml", "ls" or "both"; the last gives two entries per band, "ml" before "ls".
    """
    wanted = ("ml", "ls") if method == "both" else (method,)
    recordings = []
    for file, found in results:
        recordings.append(
            {
                "file": file,
                "bands": [_band(band, one) for band in found.bands for one in wanted],
                "mass": found.mass,
                "mass_se": found.modal.mass_se if found.modal else None,
                "actuator": found.actuator and asdict(found.actuator),
                "gain_over_frequency": found.gain and gain_json(found.gain),
                "natural_frequency": found.natural_frequency,
                "damping_ratio": found.damping_ratio,
                "distortion": found.distortion,
                "stability": _stability(found.stability) if found.stability else None,
                "transient_periods": found.transient_periods,
                "periods": found.periods,
                "notes": found.notes,
            }
        )
    return {"schema": "maglev-estimate/1", "version": version("maglev-workbench"), "recordings": plain(recordings)}


def estimate_table(identification: Identification, method: Method) -> "rich.table.Table":
    """Table of the bands for a terminal, at most 30 rows: estimates by `method`, their fit, marks of doubtful ones."""
    from rich import box
    from rich.table import Table

    bands = identification.bands
    units = units_of(bands)
    step = -(-len(bands) // ROWS)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("band\nHz", justify="right", no_wrap=True)
    for one in ("ls", "ml"):
        if method in (one, "both"):
            for name, (_, unit) in units.items():
                table.add_column(f"{one.upper()} {name}\n{unit}", justify="right", min_width=len(name))
    table.add_column("adjusted\nR2", justify="right", no_wrap=True)
    table.add_column("\ntrust", no_wrap=True, min_width=13)
    for band in bands[::step]:
        cells = [f"{band.f_lo:g}–{band.f_hi:g}"]
        for one in ("ls", "ml"):
            if method in (one, "both"):
                cells += [in_words(band, one, name, scale) for name, (scale, _) in units.items()]
        style = "dim" if not band.informative else "yellow" if band.ls_biased else ""
        table.add_row(*cells, number(band.r2_adjusted), trust(band), style=style)
    table.caption = "±, [ ]: 95 %. Yellow: noise biases least squares.\nDim: the data do not bound the estimate."
    if step > 1:
        table.caption += f"\nOne band in {step} of {len(bands)} is shown; the page and the JSON hold all."
    return table


def estimate_page(
    results: Sequence[tuple[str, Identification]],
    made_by: Mapping[str, object] | None = None,
    more: "Sequence[Sequence[tuple[str, str | Figure]]]" = (),
    answer: str = "",
) -> str:
    """The HTML of all recordings: coefficients over frequency, receptance, |S| and margins, notes.

    Args:
        results: (file, identification).
        made_by: names and values of their origin, such as the campaign and the rig.
        more: groups of sections of `maglev_workbench.page.page` that follow those of the recordings.
        answer: first sentence of the page.
    """
    sections: list[tuple[str, str | Figure]] = []
    for file, found in results:
        sections += _recording(file, found)
    for group in more:
        sections += group
    origin = {"Recordings": ", ".join(file for file, _ in results), **(made_by or {})}
    names = {0: "the rig in all recordings", 1: results[0][0] if results else ""}
    title = f"Estimate of {names.get(len(results), f'{len(results)} recordings')}"
    summary = " ".join(f"{file}: {_summary(found)}" for file, found in results[:3])
    rest = f" {len(results) - 3} more below." if len(results) > 3 else ""
    return page(
        title,
        " ".join(filter(None, (answer, summary + rest))),
        sections,
        {**origin, "Version": version("maglev-workbench")},
    )


def _band(band: Band, method: str) -> dict[str, Any]:
    entry: dict[str, Any] = {name: getattr(band, name) for name in _SHARED}
    for name in COEFFICIENTS:
        value, se, interval = estimate(band, method, name)
        entry |= {name: value, f"{name}_se": se, f"{name}_ci": interval}
        entry[f"{name}_range"] = getattr(band, f"{name}_range") if method == "ml" else None
    flags = {name: getattr(band, name) for name in ("r2_adjusted", "ls_biased", "informative")}
    return entry | {"method": method} | flags


def trust(band: Band) -> str:
    """What of a band may be trusted: "either" method, "ML" alone, "poor fit" or "uninformative"."""
    if not band.informative:
        return "uninformative"
    if band.ls_biased:
        return "ML"
    misfit = band.fit_p < MISFIT and band.r2_adjusted < POOR_FIT
    # Worse than a constant, it tells no coefficient that differs from none.
    misfit |= band.r2_adjusted < 0 and any(low > 0 or high < 0 for low, high in (band.stiffness_ci, band.damping_ci))
    return "poor fit" if misfit else "either"


def _stability(found: Stability) -> dict[str, Any]:
    return {"source": found.source, **asdict(found.margins), "iso_14839_3_zone": found.iso_14839_3_zone}


def _summary(found: Identification) -> str:
    good = sum(band.informative for band in found.bands)
    parts = [f"{good} of {len(found.bands)} bands bound stiffness and damping"]
    if found.natural_frequency is not None:
        damping = "" if found.damping_ratio is None else f" (damping ratio {number(found.damping_ratio)})"
        parts.append(f"natural frequency {number(found.natural_frequency)} Hz{damping}")
    if found.stability:
        peak, zone = found.stability.margins.peak_sensitivity, found.stability.iso_14839_3_zone
        parts.append(f"peak |S| {number(peak)}, ISO 14839-3 zone {zone} ({_source(found.stability)})")
    return ", ".join(parts) + "."


def _source(found: Stability) -> str:
    return "measured by injection" if found.source == "injection" else found.source


def _recording(file: str, found: Identification) -> "list[tuple[str, str | Figure]]":
    sections: list[tuple[str, str | Figure]] = [(file, facts(_facts(found)))]
    sections.append((f"Stiffness and damping of {file}", coefficients(found.bands)))
    text = "Bars: 95 %, to the panel's edge and beyond where unbounded. Hollow: the data do not bound the estimate. "
    text += "Crosses: least squares where noise biases it."
    sections.append(("", note(text) + _all_bands(found.bands)))
    sections.append((f"Receptance of {file}", receptance(found)))
    sections.append(("", note("Displacement over force at the excited lines; shaded: two standard deviations.")))
    if found.gain:
        sections += gain_sections(found.gain, file)
    if found.stability:
        sections.append((f"Sensitivity of {file} ({_source(found.stability)})", sensitivity(found.stability)))
        sections.append(("", note("Shaded: 95 % at each line. Dashed: where the zones of ISO 14839-3 meet.")))
        sections.append((f"Margins of {file}", facts(_margins(found.stability))))
    notes = "".join(f"<li>{html_text(text)}</li>" for text in found.notes)
    return [*sections, (f"Notes on {file}", f"<ul>{notes}</ul>")] if notes else sections


def _all_bands(bands: Sequence[Band]) -> str:
    """HTML of the bands as a table to open, by both methods."""
    units = units_of(bands)
    shown = [(one, name, *units[name]) for one in ("ml", "ls") for name in units]
    head = ["band\nHz", *(f"{one.upper()} {name}\n{unit}" for one, name, _, unit in shown), "adjusted\nR2", "\ntrust"]
    rows = [
        (f"{b.f_lo:g}–{b.f_hi:g}", *(in_words(b, one, name, scale) for one, name, scale, _ in shown),
         number(b.r2_adjusted), trust(b))
        for b in bands
    ]  # fmt: skip
    return f"<details><summary>All {len(rows)} bands as a table, with 95 %</summary>{table(head, rows)}</details>"


def _facts(found: Identification) -> list[tuple[str, str]]:
    modal, bent = found.modal, found.distortion
    mass = f"{number(found.mass, 4)} kg, given; its [tolerance] is in the intervals"
    if modal:
        half = NORMAL_95 * modal.mass_se
        mass = f"{with_interval(modal.mass, modal.mass - half, modal.mass + half)} kg, estimated"
    rows = [("Summary", _summary(found)), ("Mass", mass)]
    rows.append(("Periods", f"{found.periods} used, {found.transient_periods} dropped as transient"))
    for name in ("even", "odd"):
        level, p = getattr(bent, name), getattr(bent, f"{name}_p")
        if level is not None:
            chance = "" if p is None else f" (noise alone: p = {number(p, 2)})"
            rows.append((f"{name.capitalize()} distortion", f"{100 * level:.2g} % of the excited lines{chance}"))
    return [*rows, ("Noise", f"{100 * bent.noise:.2g} % of the excited lines")]


def _margins(found: Stability) -> list[tuple[str, str]]:
    rows = []
    for name, (label, scale, unit) in _MARGINS.items():
        value, reason = getattr(found.margins, name), found.margins.reasons.get(name)
        ends = [None if end is None else end * scale for end in found.margins.intervals.get(name, (None, None))]
        if value is None:
            rows.append((label, f"not known: {reason}"))
            continue
        at = getattr(found.margins, "peak_frequency" if name == "peak_sensitivity" else f"{name}_frequency")
        text = with_interval(value * scale, *ends) if name in found.margins.intervals else number(value * scale)
        rows.append((label, f"{text}{unit and ' ' + unit} at {number(at)} Hz" + (f"; {reason}" if reason else "")))
    return [*rows, ("ISO 14839-3 zone", found.iso_14839_3_zone)]
