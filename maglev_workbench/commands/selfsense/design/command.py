"""`maglev selfsense design`: PI gains of the rig's estimator for a lag, with phase margin and noise."""

from typing import Annotated

import typer

from maglev_workbench.commands.selfsense.options import PageOption
from maglev_workbench.options import JsonOption, RigOption, friendly

app = typer.Typer()


@app.command(epilog="Example: maglev selfsense design --lag 20")
@friendly
def design(
    rig: RigOption = "hmb_free",
    lag: Annotated[
        float | None, typer.Option(help="Largest lag of the estimate at --at, degrees (default: the rig's).")
    ] = None,
    at: Annotated[float | None, typer.Option(help="Frequency of that lag, Hz (default: the rig's).")] = None,
    droop: Annotated[float, typer.Option(help="Largest droop of the estimate below --at, dB.")] = 1.0,
    out: PageOption = None,
    json_file: JsonOption = None,
) -> None:
    """Design the estimator's PI gains: trade-off of lag, phase margin and noise."""
    from maglev_workbench.commands.selfsense.design.report import design_json, design_page, design_summary, design_table
    from maglev_workbench.commands.selfsense.design.study import STEPS, study
    from maglev_workbench.commands.selfsense.results import page_file, publish
    from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
    from maglev_workbench.console import progress_bar

    loaded, sensor = load_sensor(rig)
    page = page_file(out, "design")
    own = loaded.self_sensing
    lag, at = own.lag if lag is None else lag, own.lag_frequency if at is None else at
    with progress_bar() as bar:
        task = bar.add_task(f"design {loaded.name}", total=STEPS)
        found = study(loaded, sensor, lag, at, droop, lambda: bar.advance(task))
    publish(page, design_page(found), json_file, design_json(found), design_table(found), design_summary(found))
