"""`maglev selfsense calibrate`: gain, linearity and range of a gap sensor, and its frequency response and delay."""

from pathlib import Path

from maglev_env.recordings.campaign import load_campaign
from maglev_workbench.commands.selfsense.calibrate.report import (
    calibrate_json,
    calibrate_page,
    calibrate_summary,
    calibrate_tables,
)
from maglev_workbench.commands.selfsense.calibrate.sources import from_campaign, from_csv, simulated
from maglev_workbench.commands.selfsense.rig_sensor import DEFAULT_RIG, load_sensor
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from maglev_workbench.page import write_page


def run(source: Path | None, rig: str | None, out: Path | None, json_file: Path | None) -> None:
    """See `maglev_workbench.commands.selfsense.cli.calibrate`."""
    if source is not None and rig is not None:
        raise ValueError(f"--rig {rig} goes with the simulated calibration; {source} is calibrated as it was recorded")
    page = out or Path("selfsense-calibrate.html")
    require_folder(page, "--out")
    require_folder(json_file, "--json")
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
    write_page(page, calibrate_page(found))
    write_json(json_file, calibrate_json(found))
    for table in calibrate_tables(found):
        console.print(table)
    for note in found.notes:
        console.print(f"  note: {note}", highlight=False, markup=False)
    console.print(calibrate_summary(found), markup=False)
    console.print(f"page  {page}", markup=False)
