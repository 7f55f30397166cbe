"""`maglev selfsense robustness`: influence of wrong coil and supply parameters on the gap and the levitation loop."""

import typer

from maglev_workbench.commands.selfsense.options import PageOption
from maglev_workbench.options import JsonOption, RigOption, SeedOption, ThreadsOption, friendly

app = typer.Typer()


@app.command(epilog="Example: maglev selfsense robustness")
@friendly
def robustness(
    rig: RigOption = "hmb_free",
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
    out: PageOption = None,
    json_file: JsonOption = None,
) -> None:
    """Compute the influence of a wrong supply voltage, resistance, pole area or core on the gap and on the loop."""
    from maglev_workbench.commands.selfsense.results import page_file, publish
    from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
    from maglev_workbench.commands.selfsense.robustness.experiments import SEEDS, measure_robustness, plan_robustness
    from maglev_workbench.commands.selfsense.robustness.report import (
        robustness_json,
        robustness_page,
        robustness_summary,
        robustness_table,
    )
    from maglev_workbench.console import progress_bar

    loaded, _ = load_sensor(rig)
    plan = plan_robustness(loaded)
    page = page_file(out, "robustness")
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
