"""`maglev selfsense noise`: error of the gap over converter bits and current noise, and the Cramer-Rao bound."""

import typer

from maglev_workbench.commands.selfsense.options import PageOption
from maglev_workbench.options import JsonOption, RigOption, SeedOption, friendly

app = typer.Typer()


@app.command(epilog="Example: maglev selfsense noise")
@friendly
def noise(
    rig: RigOption = "hmb_free",
    seed: SeedOption = 0,
    out: PageOption = None,
    json_file: JsonOption = None,
) -> None:
    """Compute the gap's error over converter bits and current noise, and compare it with the Cramer-Rao bound."""
    from maglev_workbench.commands.selfsense.noise.report import noise_json, noise_page, noise_summary, noise_table
    from maglev_workbench.commands.selfsense.noise.study import plan, study
    from maglev_workbench.commands.selfsense.results import page_file, publish
    from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
    from maglev_workbench.console import progress_bar

    loaded, sensor = load_sensor(rig)
    page = page_file(out, "noise")
    with progress_bar() as bar:
        task = bar.add_task(f"noise {loaded.name}", total=len(plan(sensor)))
        found = study(loaded, sensor, seed, lambda: bar.advance(task))
    publish(page, noise_page(found), json_file, noise_json(found), noise_table(found), noise_summary(found))
