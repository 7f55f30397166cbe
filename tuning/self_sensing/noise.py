"""`maglev selfsense noise`: what converter bits and current noise leave of the gap, beside the Cramer-Rao bound."""

from pathlib import Path

from tuning.output import progress_bar
from tuning.self_sensing.noise_report import noise_json, noise_page, noise_summary, noise_table
from tuning.self_sensing.noise_study import plan, study
from tuning.self_sensing.results import page_file, publish
from tuning.self_sensing.rig_sensor import load_sensor


def run(rig: str, seed: int, out: Path | None, json_file: Path | None) -> None:
    """See `tuning.cli_selfsense.noise`."""
    loaded, sensor = load_sensor(rig)
    page = page_file(out, "noise", json_file)
    with progress_bar() as bar:
        task = bar.add_task(f"noise {loaded.name}", total=len(plan(sensor)))
        found = study(loaded, sensor, seed, lambda: bar.advance(task))
    publish(page, noise_page(found), json_file, noise_json(found), noise_table(found), noise_summary(found))
