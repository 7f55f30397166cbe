"""`maglev selfsense robustness`: what a wrong belief of coil and supply costs the gap and the levitation loop."""

from pathlib import Path

from tuning.output import progress_bar
from tuning.self_sensing.results import page_file, publish
from tuning.self_sensing.rig_sensor import load_sensor
from tuning.self_sensing.robustness_experiments import SEEDS, measure_robustness, plan_robustness
from tuning.self_sensing.robustness_report import (
    robustness_json,
    robustness_page,
    robustness_summary,
    robustness_table,
)


def run(rig: str, seed: int, threads: int | None, out: Path | None, json_file: Path | None) -> None:
    """See `tuning.cli_selfsense.robustness`."""
    loaded, _ = load_sensor(rig)
    plan = plan_robustness(loaded)
    page = page_file(out, "robustness", json_file)
    with progress_bar() as bar:
        task = bar.add_task(f"robustness {loaded.name}", total=2 * SEEDS * len(plan.tables[0]))
        found = measure_robustness(plan, seed, threads, lambda n: bar.advance(task, n))
    publish(
        page,
        robustness_page(found),
        json_file,
        robustness_json(found),
        robustness_table(found),
        robustness_summary(found),
    )
