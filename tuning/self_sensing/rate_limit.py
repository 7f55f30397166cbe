"""`maglev selfsense rate-limit`: how slowly the rig's estimator may be sampled, over its PI gains."""

from pathlib import Path

from tuning.output import console, progress_bar, require_folder, write_json
from tuning.page import write_page
from tuning.self_sensing.rate_limit_report import rate_json, rate_page, rate_summary, rate_table
from tuning.self_sensing.rate_map import STEPS, map_rates
from tuning.self_sensing.rig_sensor import load_sensor


def run(rig: str, out: Path | None, json_file: Path | None) -> None:
    """See `tuning.cli_selfsense.rate_limit`."""
    loaded, sensor = load_sensor(rig)
    page = out or Path("selfsense-rate-limit.html")
    require_folder(page, "--out")
    require_folder(json_file, "--json")
    with progress_bar() as bar:
        task = bar.add_task(f"rate limit {loaded.name}", total=STEPS)
        found = map_rates(loaded, sensor, lambda: bar.advance(task))
    write_page(page, rate_page(found))
    write_json(json_file, rate_json(found))
    console.print(rate_table(found))
    console.print(rate_summary(found), markup=False)
    console.print(f"page  {page}", markup=False)
