"""`maglev selfsense noise`: what converter bits and current noise leave of the gap, beside the Cramer-Rao bound."""

from pathlib import Path

from maglev_workbench.commands.selfsense.noise.report import noise_json, noise_page, noise_summary, noise_table
from maglev_workbench.commands.selfsense.noise.study import plan, study
from maglev_workbench.commands.selfsense.results import page_file, publish
from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
from maglev_workbench.console import progress_bar


def run(rig: str, seed: int, out: Path | None, json_file: Path | None) -> None:
    """See `maglev_workbench.commands.selfsense.cli.noise`."""
    loaded, sensor = load_sensor(rig)
    page = page_file(out, "noise", json_file)
    with progress_bar() as bar:
        task = bar.add_task(f"noise {loaded.name}", total=len(plan(sensor)))
        found = study(loaded, sensor, seed, lambda: bar.advance(task))
    publish(page, noise_page(found), json_file, noise_json(found), noise_table(found), noise_summary(found))
