"""`maglev selfsense noise`: what converter bits and current noise leave of the gap, beside the Cramer-Rao bound."""

from pathlib import Path

from tuning.output import console, progress_bar, require_folder, write_json
from tuning.page import write_page
from tuning.self_sensing.noise_report import noise_json, noise_page, noise_summary, noise_table
from tuning.self_sensing.noise_study import plan, study
from tuning.self_sensing.rig_sensor import load_sensor


def run(rig: str, seed: int, out: Path | None, json_file: Path | None) -> None:
    """See `tuning.cli_selfsense.noise`."""
    loaded, sensor = load_sensor(rig)
    page = out or Path("selfsense-noise.html")
    require_folder(page, "--out")
    require_folder(json_file, "--json")
    with progress_bar() as bar:
        task = bar.add_task(f"noise {loaded.name}", total=len(plan(sensor)))
        found = study(loaded, sensor, seed, lambda: bar.advance(task))
    write_page(page, noise_page(found))
    write_json(json_file, noise_json(found))
    console.print(noise_table(found))
    console.print(noise_summary(found), markup=False)
    console.print(f"page  {page}", markup=False)
