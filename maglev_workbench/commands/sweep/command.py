"""`maglev sweep`: run or resume, then the table, the dataset, the page and the JSON."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter

from maglev_env.design.defaults import with_defaults
from maglev_env.loop.effect import parse_effects
from maglev_env.rig.rig import load_rig
from maglev_lanes.schedule import workers
from maglev_workbench.commands.sweep.report import sweep_page, sweep_summary, sweep_table
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from maglev_workbench.page import write_page
from tuning.sweep import SWEPT, Sweep, default_axes, gain_sets, parse_axis, run_sweep


def run(
    rig: str,
    axes: Mapping[str, str | None],
    log: bool | None,
    sobol: int,
    effects: Sequence[str],
    seed: int,
    sensor: str,
    threads: int | None,
    scheduler: str | None,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """See `maglev_workbench.cli.sweep`."""
    loaded = load_rig(rig)
    if not loaded.controlled:
        raise ValueError(f"rig {loaded.name} has no controlled magnet: there is nothing to sweep")
    loaded = with_defaults(loaded)
    given = {name: parse_axis(text) for name, text in axes.items() if text is not None}
    chosen = {n: given[n] for n in SWEPT if n in given} or default_axes(loaded)
    if log is None:
        log = not given and all(axis.low > 0 for axis in chosen.values())
    plan = Sweep(loaded, chosen, log, sobol, parse_effects(effects), seed, sensor)
    folder = out or Path(f"sweep-{loaded.name}")
    require_folder(json_file, "--json")
    total = len(gain_sets(plan))
    reused = 0
    started = perf_counter()
    with workers(scheduler, threads) as spread, progress_bar() as bar:
        task = bar.add_task(f"sweep {loaded.name}", total=total)

        def advance(count: int, from_disk: bool) -> None:
            nonlocal reused
            reused += count if from_disk else 0
            bar.advance(task, count)

        try:
            dataset = run_sweep(plan, folder, threads, advance, spread)
        except KeyboardInterrupt:
            console.print(f"stopped; what is finished is in {folder}: run the same command again to go on")
            raise
    seconds = perf_counter() - started
    summary = sweep_summary(dataset, seconds, reused)
    page = folder / "sweep.html"
    write_page(page, sweep_page(dataset))
    write_json(json_file, summary)
    console.print(sweep_table(dataset))
    rate = summary["experiments_per_second"]
    console.print(
        f"{summary['n']} gain sets, {summary['stable']} stable; {seconds:.1f} s"
        + (f", {rate:.0f} experiments/s" if rate else "")
        + (f", {reused} reused from {folder}" if reused else "")
    )
    console.print(f"data  {folder / 'sweep.nc'}\npage  {page}")
