"""`maglev selfsense levitate`: compares a levitation loop with self-sensing with the same loop with the probe."""

from typing import Annotated

import typer

from maglev_workbench.commands.selfsense.options import PageOption
from maglev_workbench.options import JsonOption, RigOption, SeedOption, ThreadsOption, friendly

app = typer.Typer()


@app.command(epilog="Example: maglev selfsense levitate --rig hmb_free --points 12")
@friendly
def levitate(
    rig: RigOption = "hmb_free",
    points: Annotated[
        int, typer.Option(min=2, help="Number of values of kp and of kd in the map over the rig's bounds.")
    ] = 16,
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
    out: PageOption = None,
    json_file: JsonOption = None,
) -> None:
    """Run the same SPHS experiment with the probe and with self-sensing, and map the difference over the gains."""
    from maglev_workbench.commands.selfsense.levitate.experiments import SEEDS, compare, map_plan
    from maglev_workbench.commands.selfsense.levitate.numbers import levitate_json
    from maglev_workbench.commands.selfsense.levitate.report import levitate_page, levitate_summary, levitate_table
    from maglev_workbench.commands.selfsense.results import page_file, publish
    from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
    from maglev_workbench.console import progress_bar

    loaded, _ = load_sensor(rig)
    plan = map_plan(loaded, points, seed)
    page = page_file(out, "levitate")
    with progress_bar() as bar:
        task = bar.add_task(f"levitate {loaded.name}", total=2 * (SEEDS + points**2))
        found = compare(plan, threads, lambda n: bar.advance(task, n))
    publish(page, levitate_page(found), json_file, levitate_json(found), levitate_table(found), levitate_summary(found))
