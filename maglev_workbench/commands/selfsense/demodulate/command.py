"""`maglev selfsense demodulate`: the gap from the ripple alone beside the estimator, with constant and varying duty."""

from pathlib import Path

from maglev_workbench.commands.selfsense.demodulate.report import (
    demodulate_json,
    demodulate_page,
    demodulate_summary,
    demodulate_table,
)
from maglev_workbench.commands.selfsense.demodulate.study import compare
from maglev_workbench.commands.selfsense.results import page_file, publish
from maglev_workbench.commands.selfsense.rig_sensor import load_sensor


def run(
    rig: str,
    frequency: float,
    amplitude: float,
    duty_swing: float,
    seed: int,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """See `maglev_workbench.commands.selfsense.cli.demodulate`."""
    loaded, sensor = load_sensor(rig)
    page = page_file(out, "demodulate", json_file)
    found = compare(loaded, sensor, frequency, amplitude, duty_swing, seed)
    publish(
        page,
        demodulate_page(found),
        json_file,
        demodulate_json(found),
        demodulate_table(found),
        demodulate_summary(found),
    )
