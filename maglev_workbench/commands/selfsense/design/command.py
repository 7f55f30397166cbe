"""`maglev selfsense design`: PI gains of the rig's estimator for a lag, and what the lag costs."""

from pathlib import Path

from maglev_workbench.commands.selfsense.design.report import design_json, design_page, design_summary, design_table
from maglev_workbench.commands.selfsense.design.study import STEPS, study
from maglev_workbench.commands.selfsense.results import page_file, publish
from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
from maglev_workbench.console import progress_bar


def run(rig: str, lag: float | None, at: float | None, droop: float, out: Path | None, json_file: Path | None) -> None:
    """See `maglev_workbench.commands.selfsense.cli.design`."""
    loaded, sensor = load_sensor(rig)
    page = page_file(out, "design", json_file)
    own = loaded.self_sensing
    lag, at = own.lag if lag is None else lag, own.lag_frequency if at is None else at
    with progress_bar() as bar:
        task = bar.add_task(f"design {loaded.name}", total=STEPS)
        found = study(loaded, sensor, lag, at, droop, lambda: bar.advance(task))
    publish(page, design_page(found), json_file, design_json(found), design_table(found), design_summary(found))
