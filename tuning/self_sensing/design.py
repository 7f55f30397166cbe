"""`maglev selfsense design`: PI gains of the rig's estimator for a lag, and what the lag costs."""

from pathlib import Path

from tuning.output import progress_bar
from tuning.self_sensing.design_report import design_json, design_page, design_summary, design_table
from tuning.self_sensing.design_study import STEPS, study
from tuning.self_sensing.results import page_file, publish
from tuning.self_sensing.rig_sensor import load_sensor


def run(rig: str, lag: float | None, at: float | None, droop: float, out: Path | None, json_file: Path | None) -> None:
    """See `tuning.cli_selfsense.design`."""
    loaded, sensor = load_sensor(rig)
    page = page_file(out, "design", json_file)
    own = loaded.self_sensing
    lag, at = own.lag if lag is None else lag, own.lag_frequency if at is None else at
    with progress_bar() as bar:
        task = bar.add_task(f"design {loaded.name}", total=STEPS)
        found = study(loaded, sensor, lag, at, droop, lambda: bar.advance(task))
    publish(page, design_page(found), json_file, design_json(found), design_table(found), design_summary(found))
