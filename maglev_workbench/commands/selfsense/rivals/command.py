"""`maglev selfsense rivals`: compares state observer, Kalman filter and parameter estimator on the same motion."""

import typer

from maglev_workbench.commands.selfsense.options import PageOption
from maglev_workbench.options import JsonOption, RigOption, SeedOption, friendly

app = typer.Typer()


@app.command(epilog="Example: maglev selfsense rivals")
@friendly
def rivals(
    rig: RigOption = "hmb_free",
    seed: SeedOption = 0,
    out: PageOption = None,
    json_file: JsonOption = None,
) -> None:
    """Compare a state observer and an extended Kalman filter on the averaged current with the parameter estimator."""
    from maglev_workbench.commands.selfsense.results import page_file, publish
    from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
    from maglev_workbench.console import progress_bar

    loaded, sensor = load_sensor(rig)
    page = page_file(out, "rivals")
    # Here because the filter's package takes long to import.
    from maglev_workbench.commands.selfsense.rivals.experiments import PARTS, cases, compare
    from maglev_workbench.commands.selfsense.rivals.report import rivals_json, rivals_page, rivals_summary, rivals_table

    planned = cases(loaded, sensor)
    with progress_bar() as bar:
        task = bar.add_task(f"rivals {loaded.name}", total=PARTS + len(planned))
        found = compare(loaded, sensor, planned, seed, lambda: bar.advance(task))
    publish(page, rivals_page(found), json_file, rivals_json(found), rivals_table(found), rivals_summary(found))
