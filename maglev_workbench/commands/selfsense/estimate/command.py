"""`maglev selfsense estimate`: the gap from recorded coil currents and switching voltages; invalid parts are marked."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import JsonOption, friendly, require_campaign, require_file

app = typer.Typer()


@app.command(epilog="Example: maglev selfsense estimate scope.mat --rate 1e6 --current i*0.1 --voltage u")
@friendly
def estimate(
    source: Annotated[Path, typer.Argument(help="Campaign folder, or one .mat, .csv, .npz or .h5 file.")],
    rig: Annotated[
        str | None, typer.Option(help="Preset or rig TOML with the coil (default: the campaign's, else hmb_free).")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="One file: sample rate, Hz; required.")] = None,
    current: Annotated[str, typer.Option(help="One file: column of the coil current, name[*scale] to A.")] = "current",
    voltage: Annotated[
        str, typer.Option(help="One file: column of the switching voltage, name[*scale] to V.")
    ] = "voltage",
    point_voltage: Annotated[
        bool, typer.Option("--point-voltage", help="The voltage was read at instants, not as a mean between samples.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="HTML page (default: selfsense-estimate.html here); the gap is .npz beside it.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Estimate the gap from recorded coil current and switching voltage; invalid parts are marked, not interpolated."""
    require_campaign(source)
    from maglev_workbench.commands.selfsense.estimate.source import (
        OneFile,
        estimate_files,
        source_campaign,
        without_currents,
    )

    page = out or Path("selfsense-estimate.html")
    require_file(page, "--out")
    campaign = source_campaign(source, OneFile(rate, current, voltage))
    # What is asked for is right: now the imports that take longer.
    from maglev_env.design.defaults import with_defaults
    from maglev_env.recordings.files import write_npz
    from maglev_env.rig.rig_file import load_rig
    from maglev_env.rig.self_sensor import rig_sensors
    from maglev_workbench.commands.selfsense.estimate.recorded_coils import coils_of, read_coil, sense
    from maglev_workbench.commands.selfsense.estimate.report import (
        estimate_json,
        estimate_page,
        estimate_summary,
        estimate_table,
        stretch_lines,
    )
    from maglev_workbench.commands.selfsense.rig_sensor import DEFAULT_RIG
    from maglev_workbench.console import console, progress_bar, write_json
    from maglev_workbench.page import write_page
    from maglev_workbench.warned import warned

    loaded = load_rig(rig) if rig else campaign.rig or load_rig(DEFAULT_RIG)
    loaded = with_defaults(loaded)
    rig_sensors(loaded)  # coils that cannot sense raise here, before any work
    coils = [coil for spec in campaign.recordings for coil in coils_of(campaign, spec)]
    files = estimate_files(page, coils)
    for file in files:
        if any(file.resolve() == coil.path.resolve() for coil in coils):
            raise ValueError(f"--out {page}: the estimated gap would overwrite the recording {file}; choose another")
    warnings = warned(without_currents(campaign))
    found = []
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
    notes = []
    if not rig and not campaign.rig:
        notes.append(f"no rig is named: the coil of {DEFAULT_RIG} is assumed; name yours with --rig")
    write_page(page, estimate_page(loaded, found, settings, notes), [*files, json_file])
    write_json(json_file, estimate_json(loaded, found, settings, files, notes) | {"warnings": warnings})
    console.print(estimate_table(loaded, found))
    for coil in found:
        for line in stretch_lines(coil):
            console.print(f"  {line}", highlight=False)
    console.print(estimate_summary(loaded, found))
    for text in notes:
        console.print(text)
    for file in files:
        console.print(f"gap   {file}")
    console.print(f"page  {page}")
