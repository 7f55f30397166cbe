"""`maglev selfsense demodulate`: the gap from the ripple alone beside the estimator, with constant and varying duty."""

from pathlib import Path

from tuning.self_sensing.demodulate_report import (
    demodulate_json,
    demodulate_page,
    demodulate_summary,
    demodulate_table,
)
from tuning.self_sensing.demodulate_study import compare
from tuning.self_sensing.results import page_file, publish
from tuning.self_sensing.rig_sensor import load_sensor


def run(
    rig: str,
    frequency: float,
    amplitude: float,
    duty_swing: float,
    seed: int,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """See `tuning.cli_selfsense.demodulate`."""
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
