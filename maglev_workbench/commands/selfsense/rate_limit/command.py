"""`maglev selfsense rate-limit`: the lowest sampling rate of the rig's estimator over its PI gains."""

import typer

from maglev_workbench.commands.selfsense.options import PageOption
from maglev_workbench.options import JsonOption, RigOption, friendly

app = typer.Typer()


@app.command("rate-limit", epilog="Example: maglev selfsense rate-limit")
@friendly
def rate_limit(
    rig: RigOption = "hmb_free",
    out: PageOption = None,
    json_file: JsonOption = None,
) -> None:
    """Map the lowest stable sampling rate of the estimator over its PI gains, with a published value of 165 kHz."""
    from maglev_workbench.commands.selfsense.rate_limit.rate_map import STEPS, map_rates
    from maglev_workbench.commands.selfsense.rate_limit.report import rate_json, rate_page, rate_summary, rate_table
    from maglev_workbench.commands.selfsense.results import page_file, publish
    from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
    from maglev_workbench.console import progress_bar

    loaded, sensor = load_sensor(rig)
    page = page_file(out, "rate-limit")
    with progress_bar() as bar:
        task = bar.add_task(f"rate limit {loaded.name}", total=STEPS)
        found = map_rates(loaded, sensor, lambda: bar.advance(task))
    publish(page, rate_page(found), json_file, rate_json(found), rate_table(found), rate_summary(found))
