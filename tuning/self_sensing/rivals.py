"""`maglev selfsense rivals`: state observer and Kalman filter beside the parameter estimator, on the same motion."""

from pathlib import Path

from tuning.output import progress_bar
from tuning.self_sensing.results import page_file, publish
from tuning.self_sensing.rig_sensor import load_sensor
from tuning.self_sensing.rivals_experiments import PARTS, cases, compare
from tuning.self_sensing.rivals_report import rivals_json, rivals_page, rivals_summary, rivals_table


def run(rig: str, seed: int, out: Path | None, json_file: Path | None) -> None:
    """See `tuning.cli_selfsense.rivals`."""
    loaded, sensor = load_sensor(rig)
    page = page_file(out, "rivals", json_file)
    planned = cases(loaded, sensor)
    with progress_bar() as bar:
        task = bar.add_task(f"rivals {loaded.name}", total=PARTS + len(planned))
        found = compare(loaded, sensor, planned, seed, lambda: bar.advance(task))
    publish(page, rivals_page(found), json_file, rivals_json(found), rivals_table(found), rivals_summary(found))
