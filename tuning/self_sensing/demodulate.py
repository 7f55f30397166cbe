"""`maglev selfsense demodulate`: the gap from the ripple alone beside the estimator, with constant and varying duty."""

from pathlib import Path

from tuning.output import console, require_folder, write_json
from tuning.page import write_page
from tuning.self_sensing.demodulate_report import (
    demodulate_json,
    demodulate_page,
    demodulate_summary,
    demodulate_table,
)
from tuning.self_sensing.demodulate_study import compare
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
    page = out or Path("selfsense-demodulate.html")
    require_folder(page, "--out")
    require_folder(json_file, "--json")
    found = compare(loaded, sensor, frequency, amplitude, duty_swing, seed)
    write_page(page, demodulate_page(found))
    write_json(json_file, demodulate_json(found))
    console.print(demodulate_table(found))
    console.print(demodulate_summary(found), markup=False)
    console.print(f"page  {page}", markup=False)
