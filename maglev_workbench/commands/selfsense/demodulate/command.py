"""`maglev selfsense demodulate`: demodulation of the ripple and the estimator, at constant and varying duty."""

import typer

from maglev_workbench.commands.selfsense.options import AmplitudeOption, FrequencyOption, PageOption, SwingOption
from maglev_workbench.options import JsonOption, RigOption, SeedOption, friendly

app = typer.Typer()


@app.command(epilog="Example: maglev selfsense demodulate --duty-swing 0.1 --frequency 100")
@friendly
def demodulate(
    rig: RigOption = "hmb_free",
    frequency: FrequencyOption = 100.0,
    amplitude: AmplitudeOption = 50e-6,
    duty_swing: SwingOption = 0.1,
    seed: SeedOption = 0,
    out: PageOption = None,
    json_file: JsonOption = None,
) -> None:
    """Compare switching-noise demodulation with the parameter estimator, at constant and at varying duty."""
    from maglev_workbench.commands.selfsense.demodulate.report import (
        demodulate_json,
        demodulate_page,
        demodulate_summary,
        demodulate_table,
    )
    from maglev_workbench.commands.selfsense.demodulate.study import compare
    from maglev_workbench.commands.selfsense.results import page_file, publish
    from maglev_workbench.commands.selfsense.rig_sensor import load_sensor

    loaded, sensor = load_sensor(rig)
    page = page_file(out, "demodulate")
    found = compare(loaded, sensor, frequency, amplitude, duty_swing, seed)
    publish(
        page,
        demodulate_page(found),
        json_file,
        demodulate_json(found),
        demodulate_table(found),
        demodulate_summary(found),
    )
