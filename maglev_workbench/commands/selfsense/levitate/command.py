"""`maglev selfsense levitate`: what self-sensing costs a levitation loop, beside the same experiment with the probe."""

from pathlib import Path

from maglev_workbench.commands.selfsense.levitate.experiments import SEEDS, compare, map_plan
from maglev_workbench.commands.selfsense.levitate.numbers import levitate_json
from maglev_workbench.commands.selfsense.levitate.report import levitate_page, levitate_summary, levitate_table
from maglev_workbench.commands.selfsense.results import page_file, publish
from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
from maglev_workbench.console import progress_bar


def run(rig: str, points: int, seed: int, threads: int | None, out: Path | None, json_file: Path | None) -> None:
    """See `maglev_workbench.commands.selfsense.cli.levitate`."""
    loaded, _ = load_sensor(rig)
    plan = map_plan(loaded, points, seed)
    page = page_file(out, "levitate", json_file)
    with progress_bar() as bar:
        task = bar.add_task(f"levitate {loaded.name}", total=2 * (SEEDS + points**2))
        found = compare(plan, threads, lambda n: bar.advance(task, n))
    publish(page, levitate_page(found), json_file, levitate_json(found), levitate_table(found), levitate_summary(found))
