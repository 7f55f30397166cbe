"""`maglev selfsense estimate`: the gap from recorded coil currents and switching voltages, faults flagged."""

from dataclasses import dataclass
from pathlib import Path

from maglev_env.design.defaults import with_defaults
from maglev_env.recordings.campaign import Campaign, RecordingSpec, load_campaign
from maglev_env.recordings.files import write_npz
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import load_rig
from maglev_env.rig.self_sensor import rig_sensors
from maglev_workbench.columns import column_source
from maglev_workbench.commands.selfsense.estimate.recorded_coils import Coil, SensedCoil, coils_of, read_coil, sense
from maglev_workbench.commands.selfsense.estimate.report import (
    estimate_json,
    estimate_page,
    estimate_summary,
    estimate_table,
    stretch_lines,
)
from maglev_workbench.commands.selfsense.rig_sensor import DEFAULT_RIG
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from maglev_workbench.page import write_page


@dataclass(frozen=True)
class OneFile:
    """How to read a single file: rate Hz (None: not given), columns name[*scale] of the current and the voltage."""

    rate: float | None = None
    current: str = "current"
    voltage: str = "voltage"


def run(
    source: Path, rig: str | None, one: OneFile, point_voltage: bool, out: Path | None, json_file: Path | None
) -> None:
    """See `maglev_workbench.commands.selfsense.cli.estimate`."""
    page = out or Path("selfsense-estimate.html")
    require_folder(page, "--out")
    require_folder(json_file, "--json")
    campaign = _campaign(source, one)
    loaded = load_rig(rig) if rig else campaign.rig or load_rig(DEFAULT_RIG)
    loaded = with_defaults(loaded)
    rig_sensors(loaded)  # coils that cannot sense raise here, before any work
    coils = [coil for spec in campaign.recordings for coil in coils_of(campaign, spec)]
    files = _estimate_files(page, coils)
    for file in files:
        if any(file.resolve() == coil.path.resolve() for coil in coils):
            raise ValueError(f"--out {page}: the estimated gap would overwrite the recording {file}; choose another")
    found: list[SensedCoil] = []
    with progress_bar() as bar:
        for coil in bar.track(coils, description=f"estimate {loaded.name}"):
            try:
                found.append(sense(coil, read_coil(campaign, coil), loaded, "point" if point_voltage else "mean"))
            except ValueError as error:
                text = str(error)
                raise ValueError(text if str(coil.path) in text else f"{coil.path}: {text}") from error
    for file, coil in zip(files, found, strict=True):
        write_npz(file, {"time": coil.gap.time, "gap": coil.gap.gap, "displacement": coil.sensor.gap - coil.gap.gap})
    settings = {"source": str(source), "voltage_sampling": "point" if point_voltage else "mean"}
    write_page(page, estimate_page(loaded, found, settings))
    write_json(json_file, estimate_json(loaded, found, settings, files))
    console.print(estimate_table(loaded, found))
    for coil in found:
        for line in stretch_lines(coil):
            console.print(f"  {line}", highlight=False, markup=False)
    console.print(estimate_summary(loaded, found), markup=False)
    if not rig and not campaign.rig:
        console.print(f"no rig is named: the coil of {DEFAULT_RIG} is assumed; name yours with --rig", markup=False)
    for file in files:
        console.print(f"gap   {file}", markup=False)
    console.print(f"page  {page}", markup=False)


def _campaign(source: Path, one: OneFile) -> Campaign:
    if not source.exists():
        raise FileNotFoundError(f"{source} does not exist; name a campaign folder or a data file")
    if source.is_dir() or source.suffix == ".toml":
        if one != OneFile():
            raise ValueError(f"--rate, --current and --voltage go with one file; the campaign {source} states its own")
        return load_campaign(source)
    if one.rate is None or not 0 < one.rate < float("inf"):
        raise ValueError(f"{source}: one file needs its sample rate: --rate HZ")
    channels = {"current": column_source(one.current), "voltage": column_source(one.voltage)}
    excitations = (Excitation("none"),)
    spec = RecordingSpec(source.name, "fit", one.rate, 0, None, None, 0.0, None, excitations, channels)
    return Campaign(source.parent, None, None, (spec,))


def _estimate_files(page: Path, coils: list[Coil]) -> list[Path]:
    """Where each estimated gap goes: beside the page, named after it, and after the recording where there are more."""
    if len(coils) == 1:
        return [page.with_suffix(".npz")]
    names = ["-".join((*Path(c.spec.file).with_suffix("").parts, *filter(None, [c.suffix.lstrip("_")]))) for c in coils]
    unique = [n if names.count(n) == 1 else f"{n}-{i}" for i, n in enumerate(names, 1)]
    return [page.with_name(f"{page.stem}-{name}.npz") for name in unique]
