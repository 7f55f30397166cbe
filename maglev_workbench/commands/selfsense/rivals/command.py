"""`maglev selfsense rivals`: state observer and Kalman filter beside the parameter estimator, on the same motion."""

from pathlib import Path

from maglev_workbench.commands.selfsense.results import page_file, publish
from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
from maglev_workbench.commands.selfsense.rivals.experiments import PARTS, cases, compare
from maglev_workbench.commands.selfsense.rivals.report import rivals_json, rivals_page, rivals_summary, rivals_table
from maglev_workbench.console import progress_bar


def run(rig: str, seed: int, out: Path | None, json_file: Path | None) -> None:
    """See `maglev_workbench.commands.selfsense.cli.rivals`."""
    loaded, sensor = load_sensor(rig)
    page = page_file(out, "rivals", json_file)
    planned = cases(loaded, sensor)
    with progress_bar() as bar:
        task = bar.add_task(f"rivals {loaded.name}", total=PARTS + len(planned))
        found = compare(loaded, sensor, planned, seed, lambda: bar.advance(task))
    publish(page, rivals_page(found), json_file, rivals_json(found), rivals_table(found), rivals_summary(found))
