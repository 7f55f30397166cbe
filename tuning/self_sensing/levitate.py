"""`maglev selfsense levitate`: what self-sensing costs a levitation loop, beside the same experiment with the probe."""

from pathlib import Path

from tuning.output import console, progress_bar, require_folder, write_json
from tuning.page import write_page
from tuning.self_sensing.levitate_experiments import SEEDS, compare, map_plan
from tuning.self_sensing.levitate_numbers import levitate_json
from tuning.self_sensing.levitate_report import levitate_page, levitate_summary, levitate_table
from tuning.self_sensing.rig_sensor import load_sensor


def run(rig: str, points: int, seed: int, threads: int | None, out: Path | None, json_file: Path | None) -> None:
    """See `tuning.cli_selfsense.levitate`."""
    loaded, _ = load_sensor(rig)
    plan = map_plan(loaded, points, seed)
    page = out or Path("selfsense-levitate.html")
    require_folder(page, "--out")
    require_folder(json_file, "--json")
    with progress_bar() as bar:
        task = bar.add_task(f"levitate {loaded.name}", total=2 * (SEEDS + points**2))
        found = compare(plan, threads, lambda n: bar.advance(task, n))
    write_page(page, levitate_page(found))
    write_json(json_file, levitate_json(found))
    console.print(levitate_table(found))
    console.print(levitate_summary(found), markup=False)
    console.print(f"page  {page}", markup=False)
