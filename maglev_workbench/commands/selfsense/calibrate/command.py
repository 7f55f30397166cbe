"""`maglev selfsense calibrate`: gain, linearity and range of a gap sensor, and its frequency response and delay."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.commands.selfsense.options import PageOption
from maglev_workbench.options import JsonOption, friendly, require_file

app = typer.Typer()


@app.command(epilog="Example: maglev simulate --sensor self_sensing --out sensed && maglev selfsense calibrate sensed")
@friendly
def calibrate(
    source: Annotated[Path | None, typer.Argument(help="Campaign folder or .csv table (default: simulate).")] = None,
    rig: Annotated[
        str | None, typer.Option(help="Preset or rig TOML to simulate without SOURCE (default: hmb_free).")
    ] = None,
    out: PageOption = None,
    json_file: JsonOption = None,
) -> None:
    """Calibrate a gap sensor: static (steps: gain, linearity, range) and dynamic (SPHS: frequency response, delay).

    SOURCE is a campaign with displacement and gap_estimate, or a .csv of displacement and output for the static one.
    """
    from maglev_env.recordings.campaign import load_campaign
    from maglev_workbench.commands.selfsense.calibrate.report import (
        calibrate_json,
        calibrate_page,
        calibrate_summary,
        calibrate_tables,
    )
    from maglev_workbench.commands.selfsense.calibrate.sources import from_campaign, from_csv, simulated
    from maglev_workbench.commands.selfsense.rig_sensor import DEFAULT_RIG, load_sensor
    from maglev_workbench.console import console, progress_bar, write_json
    from maglev_workbench.page import write_page

    if source is not None and rig is not None:
        raise ValueError(f"--rig {rig} goes with the simulated calibration; {source} is calibrated as it was recorded")
    page = out or Path("selfsense-calibrate.html")
    require_file(page, "--out")
    if source is None:
        loaded, sensor = load_sensor(rig or DEFAULT_RIG)
        with progress_bar() as bar:
            task = bar.add_task(f"calibrate {loaded.name}", total=2)
            found = simulated(loaded, sensor, lambda: bar.advance(task))
    elif not source.exists():
        raise FileNotFoundError(f"{source} does not exist; name a campaign folder or a .csv file")
    elif source.is_dir() or source.suffix == ".toml":
        campaign = load_campaign(source)
        with progress_bar() as bar:
            found = from_campaign(campaign, source, lambda specs: bar.track(specs, description="calibrate"))
    elif source.suffix.lower() == ".csv":
        found = from_csv(source)
    else:
        raise ValueError(f"{source}: give a campaign folder, or a .csv file with columns displacement and output")
    write_page(page, calibrate_page(found), [json_file])
    write_json(json_file, calibrate_json(found))
    for table in calibrate_tables(found):
        console.print(table)
    for note in found.notes:
        console.print(f"  note: {note}", highlight=False)
    console.print(calibrate_summary(found))
    console.print(f"page  {page}")
