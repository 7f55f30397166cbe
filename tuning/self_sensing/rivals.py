"""`maglev selfsense rivals`: state observer and Kalman filter beside the parameter estimator, on the same motion."""

from pathlib import Path

from tuning.output import console, progress_bar, require_folder, write_json
from tuning.page import write_page
from tuning.self_sensing.rig_sensor import load_sensor
from tuning.self_sensing.rivals_experiments import PARTS, cases, compare
from tuning.self_sensing.rivals_report import rivals_json, rivals_page, rivals_summary, rivals_table


def run(rig: str, seed: int, out: Path | None, json_file: Path | None) -> None:
    """See `tuning.cli_selfsense.rivals`."""
    loaded, sensor = load_sensor(rig)
    page = out or Path("selfsense-rivals.html")
    require_folder(page, "--out")
    require_folder(json_file, "--json")
    planned = cases(loaded, sensor)
    with progress_bar() as bar:
        task = bar.add_task(f"rivals {loaded.name}", total=PARTS + len(planned))
        found = compare(loaded, sensor, planned, seed, lambda: bar.advance(task))
    write_page(page, rivals_page(found))
    write_json(json_file, rivals_json(found))
    console.print(rivals_table(found))
    console.print(rivals_summary(found), markup=False)
    console.print(f"page  {page}", markup=False)
