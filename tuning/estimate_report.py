"""Reports of `maglev estimate`: JSON, a terminal table per recording, and one page of all recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from html import escape
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from estimation.frequency_response import frequency_response
from maglev_env.identify import Band, Identification, Stability
from tuning.page import (
    COLOURS,
    facts,
    labelled_axis,
    mark_iso_zones,
    note,
    number,
    page,
    plain,
    shaded,
    styled,
    with_interval,
)

if TYPE_CHECKING:
    import rich.table
    from plotly.graph_objects import Figure

Method = Literal["ls", "ml", "both"]
ROWS = 30  # bands that a terminal shows
_SHARED = ("f_lo", "f_hi")
_COEFFICIENTS = {"stiffness": (1e-3, "kN/m"), "damping": (1.0, "N s/m")}  # factor from SI, unit
_MARGINS = {  # label, factor from SI, unit
    "peak_sensitivity": ("Peak |S|", 1.0, ""),
    "phase_margin": ("Phase margin", 1.0, "°"),
    "gain_margin_low": ("Gain margin down", 1.0, ""),
    "gain_margin_high": ("Gain margin up", 1.0, ""),
    "delay_margin": ("Delay margin", 1e6, "us"),
    "disk_margin": ("Disk margin", 1.0, ""),
}


def estimate_json(results: Sequence[tuple[str, Identification]], method: Method) -> dict[str, Any]:
    """Recordings as JSON data, schema maglev-estimate/1, SI; what is missing or unbounded is None.

    results: (file, identification); method "both" gives two entries per band, "ml" before "ls".
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
                "natural_frequency": found.natural_frequency,
                "damping_ratio": found.damping_ratio,
                "distortion": found.distortion,
                "stability": _stability(found.stability) if found.stability else None,
                "transient_periods": found.transient_periods,
                "periods": found.periods,
                "notes": found.notes,
            }
        )
    return {"schema": "maglev-estimate/1", "recordings": plain(recordings)}


def estimate_table(identification: Identification, method: Method) -> "rich.table.Table":
    """Bands for a terminal, at most 30 rows: the estimates by `method`, their fit, and which of them to trust."""
    from rich import box
    from rich.table import Table

    bands = identification.bands
    step = -(-len(bands) // ROWS)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("band\nHz", justify="right", no_wrap=True)
    for one in ("ls", "ml"):
        if method in (one, "both"):
            for name, (_, unit) in _COEFFICIENTS.items():
                table.add_column(f"{one.upper()} {name}\n{unit}", justify="right")
    table.add_column("adjusted\nR2", justify="right", no_wrap=True)
    table.add_column("\ntrust", no_wrap=True)
    for band in bands[::step]:
        cells = [f"{band.f_lo:g}–{band.f_hi:g}"]
        for one in ("ls", "ml"):
            if method in (one, "both"):
                cells += [_text(band, one, name) for name in _COEFFICIENTS]
        style = "dim" if not band.informative else "yellow" if band.ls_biased else ""
        table.add_row(*cells, number(band.r2_adjusted), _trust(band), style=style)
    table.caption = "±, [ ]: 95 %. Yellow: noise biases least squares. Dim: the data do not bound the estimate."
    if step > 1:
        table.caption += f"\nOne band in {step} of {len(bands)} is shown; the page and the JSON hold all."
    return table


def estimate_page(results: Sequence[tuple[str, Identification]], made_by: Mapping[str, object] | None = None) -> str:
    """The HTML of all recordings: coefficients against frequency, receptance, |S| and margins, notes.

    made_by: what the caller knows of their origin, such as the campaign and the rig.
    """
    sections: list[tuple[str, str | Figure]] = []
    for file, found in results:
        sections += _recording(file, found)
    origin = {"Recordings": ", ".join(file for file, _ in results), **(made_by or {})}
    title = f"Estimate of {results[0][0]}" if len(results) == 1 else f"Estimate of {len(results)} recordings"
    summary = " ".join(f"{file}: {_summary(found)}" for file, found in results[:3])
    more = f" {len(results) - 3} more below." if len(results) > 3 else ""
    return page(title, summary + more, sections, {**origin, "Version": version("maglev-workbench")})


def _band(band: Band, method: str) -> dict[str, Any]:
    entry: dict[str, Any] = {name: getattr(band, name) for name in _SHARED}
    for name in _COEFFICIENTS:
        value, se, interval = _estimate(band, method, name)
        entry |= {name: value, f"{name}_se": se, f"{name}_ci": interval}
    flags = {name: getattr(band, name) for name in ("r2_adjusted", "ls_biased", "informative")}
    return entry | {"method": method} | flags


def _estimate(band: Band, method: str, name: str) -> tuple[float, float, tuple[float, float]]:
    """Value, standard error and 95 % interval of a coefficient by one method, SI."""
    if method == "ml":
        return getattr(band, name), getattr(band, f"{name}_se"), getattr(band, f"{name}_ci")
    value, se = getattr(band, f"ls_{name}"), getattr(band, f"ls_{name}_se")
    return value, se, (value - 1.96 * se, value + 1.96 * se)


def _text(band: Band, method: str, name: str) -> str:
    scale = _COEFFICIENTS[name][0]
    value, _, (low, high) = _estimate(band, method, name)
    return with_interval(value * scale, low * scale, high * scale)


def _trust(band: Band) -> str:
    if not band.informative:
        return "uninformative"
    return "ML" if band.ls_biased else "either"


def _stability(found: Stability) -> dict[str, Any]:
    zones = {name: getattr(found, name) for name in ("iso_14839_3_zone", "iso_14839_2_zone")}
    return {"source": found.source, **asdict(found.margins), **zones}


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
    sections.append((f"Stiffness and damping of {file}", _coefficients(found.bands)))
    text = "Bars: 95 %, to the panel's edge and beyond where unbounded. Hollow: the data do not bound the estimate. "
    text += "Crosses: least squares where noise biases it."
    sections.append(("", note(text)))
    sections.append((f"Receptance of {file}", _receptance(found)))
    sections.append(("", note("Displacement over force at the excited lines; shaded: two standard deviations.")))
    if found.stability:
        sections.append((f"Sensitivity of {file} ({_source(found.stability)})", _sensitivity(found.stability)))
        sections.append(("", note("Shaded: 95 % at each line. Dashed: where the zones of ISO 14839-3 meet.")))
        sections.append((f"Margins of {file}", facts(_margins(found.stability))))
    notes = "".join(f"<li>{escape(text)}</li>" for text in found.notes)
    return [*sections, (f"Notes on {file}", f"<ul>{notes}</ul>")] if notes else sections


def _facts(found: Identification) -> list[tuple[str, str]]:
    modal, bent = found.modal, found.distortion
    mass = f"{number(found.mass, 4)} kg, given"
    if modal:
        mass = f"{with_interval(modal.mass, modal.mass - 1.96 * modal.mass_se, modal.mass + 1.96 * modal.mass_se)} kg"
        mass += ", estimated"
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
        rows.append((label, f"{text} {unit} at {number(at)} Hz" + (f"; {reason}" if reason else "")))
    rows.append(("ISO 14839-3 zone", found.iso_14839_3_zone))
    return [*rows, ("ISO 14839-2 zone", found.iso_14839_2_zone)] if found.iso_14839_2_zone else rows


def _coefficients(bands: Sequence[Band]) -> "Figure":
    """Stiffness and damping against frequency: maximum likelihood with bars, least squares, effective ones."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    titles = [f"{name} in {unit}" for name, (_, unit) in _COEFFICIENTS.items()]
    figure = styled(make_subplots(1, 2, subplot_titles=titles), 460)
    centre = np.array([(band.f_lo + band.f_hi) / 2 for band in bands])
    good = np.array([band.informative for band in bands])
    biased = np.array([band.ls_biased for band in bands])
    for col, (name, (scale, unit)) in enumerate(_COEFFICIENTS.items(), 1):
        ml, low, high = scale * np.array([(getattr(b, name), *getattr(b, f"{name}_ci")) for b in bands]).T
        ls = scale * np.array([getattr(b, f"ls_{name}") for b in bands])
        promised = [getattr(b, f"effective_{name}") for b in bands]
        core = np.concatenate([ml[good], ls[good & ~biased]]) if good.any() else ml
        bottom, top = np.nanmin(core), np.nanmax(core)
        pad = 0.15 * (top - bottom) + 0.02 * abs(top) + 1e-12
        figure.update_yaxes(range=[bottom - pad, top + pad], row=1, col=col)
        reach = 2 * (top - bottom + 2 * pad)  # stands for infinity: beyond the panel
        low, high = np.clip(low, bottom - reach, ml), np.clip(high, ml, top + reach)
        symbols = ["x-thin-open" if b else "circle" for b in biased]
        marker = {"symbol": symbols, "size": [8 if b else 3 for b in biased]}
        extra = {"legendgroup": "LS", "showlegend": col == 1, "name": "least squares"}
        figure.add_trace(Scatter(x=centre, y=ls, line={"color": COLOURS[1], "width": 1.5}, marker=marker,
                                 mode="lines+markers", **extra), row=1, col=col)  # fmt: skip
        for some, opacity, symbol, label in ((good, 1, "circle", "ML"), (~good, 0.4, "circle-open", "ML, unbounded")):
            if some.any():
                ends = np.stack([low, high], axis=-1)[some]
                bars = {"array": ends[:, 1] - ml[some], "arrayminus": ml[some] - ends[:, 0], "thickness": 1, "width": 2}
                text = f"%{{x:g}} Hz: %{{y:.4g}} {unit}<br>%{{text}}<extra>{label}</extra>"
                hover = [_text(b, "ml", name) for b, wanted in zip(bands, some, strict=True) if wanted]
                trace = {"x": centre[some], "y": ml[some], "text": hover, "hovertemplate": text, "mode": "markers"}
                style = {"marker": {"color": COLOURS[0], "symbol": symbol, "size": 6}, "opacity": opacity}
                shown = {"name": label, "legendgroup": label, "showlegend": col == 1}
                figure.add_trace(Scatter(**trace, **style, **shown, error_y=bars), row=1, col=col)
        if any(value is not None for value in promised):
            y = [None if value is None else scale * value for value in promised]
            extra = {"legendgroup": "eff", "showlegend": col == 1, "name": "promised by the gains"}
            line = {"color": COLOURS[2], "dash": "dash"}
            figure.add_trace(Scatter(x=centre, y=y, mode="lines", line=line, **extra), row=1, col=col)
    figure.update_xaxes(title_text="centre of the band in Hz")
    return figure.update_layout(legend={"orientation": "h", "y": -0.2})


def _receptance(found: Identification) -> "Figure":
    """Bode diagram of displacement over force with two standard deviations."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    f = found.statistics.frequency
    g, variance = frequency_response(found.statistics, "displacement", "force")
    size, sigma = np.abs(g), np.sqrt(variance / 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        # A band that reaches zero is cut 40 dB below the magnitude.
        low, high = (20 * np.log10(np.maximum(size + s * sigma, size / 100)) for s in (-2, 2))
        turn = np.degrees(np.arcsin(np.minimum(1.0, 2 * sigma / size)))
        turn = np.where(2 * sigma >= size, 360.0, turn)
        phase = (np.degrees(np.angle(g)) + 270) % 360 - 270  # from -270 to 90: a mass's -180 is not at the seam
        decibels = 20 * np.log10(size)
    figure = styled(make_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.06), 560)
    line = {"mode": "lines+markers", "line": {"color": COLOURS[0], "width": 1.2}, "marker": {"size": 3}}
    for row, (y, bottom, top, unit) in enumerate(
        ((decibels, low, high, "dB"), (phase, *np.clip([phase - turn, phase + turn], -270, 90), "°")), 1
    ):
        figure.add_trace(shaded(f, bottom, top, COLOURS[0]), row=row, col=1)
        text = f"%{{x:.4g}} Hz: %{{y:.4g}} {unit}<extra></extra>"
        figure.add_trace(Scatter(x=f, y=y, hovertemplate=text, showlegend=False, **line), row=row, col=1)
    figure.update_xaxes(**labelled_axis("", f, log=True)).update_xaxes(title_text="frequency in Hz", row=2, col=1)
    figure.update_yaxes(title_text="magnitude in dB re 1 m/N", row=1, col=1)
    return figure.update_yaxes(title_text="phase in °", dtick=45, row=2, col=1)


def _sensitivity(found: Stability) -> "Figure":
    """|S| against frequency with 95 % bands and the limits of ISO 14839-3."""
    from plotly.graph_objects import Figure, Scatter

    size, half = np.abs(found.sensitivity), 1.96 * np.sqrt(found.variance / 2)
    low = np.maximum(size - half, size / 100)
    figure = styled(Figure(shaded(found.frequency, low, size + half, COLOURS[0])), 420)
    text = "%{x:.4g} Hz: |S| %{y:.4g} ± %{customdata:.2g}<extra></extra>"
    line = {"mode": "lines+markers", "line": {"color": COLOURS[0], "width": 1.2}, "marker": {"size": 4}}
    figure.add_trace(Scatter(x=found.frequency, y=size, customdata=half, hovertemplate=text, showlegend=False, **line))
    mark_iso_zones(figure, log=True)
    ends = np.array([np.nanmin(size) / 1.3, max(6.0, 1.2 * np.nanmax(size))])
    figure.update_xaxes(**labelled_axis("frequency in Hz", found.frequency, log=True))
    return figure.update_yaxes(**labelled_axis("|S|", ends, log=True), range=np.log10(ends))
