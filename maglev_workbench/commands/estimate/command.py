"""`maglev estimate`: a campaign, or one file for a first look, to stiffness, damping and margins."""

from dataclasses import dataclass
from pathlib import Path

from rich.markup import escape

from maglev_env.evaluation.identification import Identification, identify
from maglev_env.evaluation.identification_planar import PlanarIdentification, identify_planar
from maglev_env.loop.axes import AXES
from maglev_env.recordings.campaign import Campaign, RecordingSpec, load_campaign
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.rig.excitation import Excitation, parse_lines
from maglev_env.rig.rig import Rig, axis_rig
from maglev_workbench.columns import column_source
from maglev_workbench.commands.estimate.planar_report import planar_json, planar_sections, planar_table
from maglev_workbench.commands.estimate.report import estimate_json, estimate_page, estimate_table
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from maglev_workbench.page import write_page

METHODS = ("ls", "ml", "both")


@dataclass(frozen=True)
class OneFile:
    """How to read a single file: rate Hz (None: not given), fundamental Hz, lines first:last[:step], or recorded (not
    periodic), columns name[*scale] of force and displacement, first sample and how many, and the force "bl" or "zoh"
    between samples."""

    rate: float | None
    fundamental: float
    lines: str
    recorded: bool
    force: str
    displacement: str
    start: int
    samples: int | None
    intersample: str | None


def run(
    source: Path,
    method: str,
    estimate_mass: bool,
    band_width: float | None,
    band_overlap: float | None,
    mass: float | None,
    one: OneFile,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """See `maglev_workbench.cli.estimate`."""
    if method not in METHODS:
        raise ValueError(f"--method {method}: use one of {', '.join(METHODS)}")
    if mass is not None and not mass > 0:
        raise ValueError(f"--mass {mass} kg must be positive")
    if mass is not None and estimate_mass:
        raise ValueError("give --mass or --estimate-mass, not both")
    if not source.exists():
        raise FileNotFoundError(f"{source} does not exist; name a campaign folder or a data file")
    if band_width is not None and not band_width > 0:
        raise ValueError(f"--band-width {band_width} Hz must be positive")
    is_campaign = source.is_dir() or source.suffix == ".toml"
    campaign = load_campaign(source) if is_campaign else _single(source, mass, one)
    page = out or (campaign.folder / "estimate.html" if is_campaign else source.with_suffix(".html"))
    require_folder(page, "--out")
    require_folder(json_file, "--json")
    mass = campaign.mass if mass is None else mass
    results: list[tuple[str, Identification]] = []
    planar: list[tuple[str, PlanarIdentification]] = []
    with progress_bar() as bar:
        loops: dict[tuple, list[tuple[str, RecordedSignals]]] = {}
        for spec in bar.track(campaign.recordings, description="estimate"):
            signals = recorded_signals(campaign, spec, read_recording(campaign, spec))
            try:
                results += _axes(spec.file, signals, campaign.rig, mass, estimate_mass, band_width, band_overlap)
            except ValueError as error:
                raise ValueError(f"{campaign.folder / spec.file}: {error}") from error
            if signals.axes == 2 and spec.role == "fit" and mass is not None:
                loops.setdefault((spec.gains, spec.speed_rpm), []).append((spec.file, signals))
        for members in loops.values():
            records = [signals for _, signals in members]
            found = identify_planar(records, campaign.rig, mass, band_width, band_overlap)
            planar.append((" + ".join(file for file, _ in members), found))
    rig = f"{campaign.rig.name}, {mass:g} kg" if campaign.rig else "not given"
    made_by = {"Rig": rig, "Campaign": str(campaign.folder)}
    write_page(page, estimate_page(results, made_by, [planar_sections(*one) for one in planar]))
    report = estimate_json(results, method)
    write_json(json_file, report | {"planar": [planar_json(*one) for one in planar]} if planar else report)
    for file, found in results:
        console.print(f"\n[bold]{escape(file)}[/]")
        console.print(estimate_table(found, method))
        _say(found)
    for files, found in planar:
        console.print(f"\n[bold]x and y together: {escape(files)}[/]")
        console.print(planar_table(found))
        for note in found.notes:
            console.print(f"  note: {note}")
    console.print(f"page  {page}")


def _axes(
    file: str, signals: RecordedSignals, rig: Rig | None, mass: float | None, *options: object
) -> list[tuple[str, Identification]]:
    """The identification of a recording, of each axis by itself where there are two."""
    parts = [(file, signals)]
    if signals.axes == 2:
        parts = [(f"{file}, {name}", axis_signals(signals, axis)) for axis, name in enumerate(AXES)]
        # An axis that nothing pushes along tells nothing by itself.
        pushed = [(name, own) for name, own in parts if any(e.at == "force" for e in own.excitations)]
        parts = pushed or [(name, own) for name, own in parts if own.excitations]
    found = []
    for name, own in parts:
        one = rig if rig is None or own.axis is None else axis_rig(rig, own.axis)
        # A mass given stands for the rig's common one; an axis may have its own share of it.
        share = mass if mass is None or one is None or rig is None else mass * one.mass / rig.mass
        found.append((name, identify(own, one, share, *options)))
    return found


def _say(found: Identification) -> None:
    if found.modal:
        m = found.modal
        console.print(f"mass {m.mass:.5g} +- {1.96 * m.mass_se:.2g} kg")
    if found.actuator:
        a = found.actuator
        console.print(f"actuator gain {a.gain:.4g} +- {1.96 * a.gain_se:.2g} N/A")
        console.print(f"stiffness without control {a.stiffness / 1e3:.4g} +- {1.96 * a.stiffness_se / 1e3:.2g} kN/m")
    if found.natural_frequency is not None:
        console.print(f"natural frequency {found.natural_frequency:.2f} Hz, damping ratio {found.damping_ratio:.4f}")
    d = found.distortion
    for name, level, p in (("even", d.even, d.even_p), ("odd", d.odd, d.odd_p)):
        if level is not None:
            console.print(
                f"{name} distortion {level:.2%} of the excited lines" + (f" (p = {p:.2g})" if p is not None else "")
            )
    if found.stability:
        s = found.stability
        ci = s.margins.intervals.get("peak_sensitivity")
        bounds = " .. ".join("?" if v is None else f"{v:.2f}" for v in ci) if ci else "no interval"
        console.print(
            f"peak sensitivity {s.margins.peak_sensitivity:.2f} ({bounds}), "
            f"ISO 14839-3 zone {s.iso_14839_3_zone}; {s.source}"
        )
        if "peak_sensitivity" in s.margins.reasons:
            console.print(f"  [yellow]![/] peak sensitivity: {s.margins.reasons['peak_sensitivity']}")
        for name, unit in (("gain_margin_low", ""), ("gain_margin_high", ""), ("phase_margin", " deg")):
            value = getattr(s.margins, name)
            text = f"{value:.3g}{unit}" if value is not None else s.margins.reasons.get(name, "not found")
            console.print(f"{name.replace('_', ' ')} {text}")
    for note in found.notes:
        console.print(f"  note: {note}")


def _single(path: Path, mass: float | None, one: OneFile) -> Campaign:
    if one.rate is None or not one.rate > 0:
        raise ValueError(f"{path}: one file needs its sample rate: --rate HZ")
    if one.recorded:
        excitation = Excitation("recorded", "force")
    else:
        excitation = Excitation("sphs", "force", one.fundamental, parse_lines(one.lines))
    channels = {"force": column_source(one.force), "displacement": column_source(one.displacement)}
    spec = RecordingSpec(
        path.name,
        "fit",
        one.rate,
        one.start,
        one.samples,
        None,
        0.0,
        None,
        (excitation,),
        channels,
        one.intersample,
    )
    return Campaign(path.parent, None, mass, (spec,))
