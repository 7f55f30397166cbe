"""`maglev sweep`: runs or resumes a sweep and writes table, dataset, page and JSON."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import (
    ControllerOption,
    DeviceOption,
    EffectOption,
    GoalOption,
    JsonOption,
    RigOption,
    SchedulerOption,
    SeedOption,
    SensorOption,
    ThreadsOption,
    friendly,
    require_apart,
    require_choice,
    require_folder,
)

app = typer.Typer()


@app.command(epilog="Example: maglev sweep --rig hmb_free --kp 4000:16000:16 --kd 2:12:16 --out my-sweep")
@friendly
def sweep(
    rig: RigOption = "hmb_free",
    kp: Annotated[str | None, typer.Option(help="lo:hi:n in A/m, or one value.")] = None,
    ki: Annotated[str | None, typer.Option(help="lo:hi:n in A/m, or one value.")] = None,
    kd: Annotated[str | None, typer.Option(help="lo:hi:n in A s/m, or one value.")] = None,
    gain: Annotated[
        list[str], typer.Option(metavar="NAME=LO:HI:N", help="Any gain of the controller, in SI; repeat.")
    ] = [],  # noqa: B006
    controller: ControllerOption = None,
    log: Annotated[
        bool | None, typer.Option("--log/--linear", help="Spacing (default: log over the rig's bounds).")
    ] = None,
    sobol: Annotated[int, typer.Option(min=0, help="Number of Sobol points, instead of a grid.")] = 0,
    goal: GoalOption = None,
    effect: EffectOption = [],  # noqa: B006
    sensor: SensorOption = "probe",
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
    device: DeviceOption = "cpu",
    scheduler: SchedulerOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; an interrupted sweep resumes there.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Score every gain set of a grid (or Sobol set) by a simulated SPHS experiment: table, dataset and HTML maps.

    Without --kp, --ki, --kd and --gain the sweep covers the rig's bounds; with some, the others stay at the preset. The
    default grid takes some ten seconds on two cores, and the first run as long again to compile.
    """
    from tuning.axis import parse_axes

    given = parse_axes([f"{n}={text}" for n, text in (("kp", kp), ("ki", ki), ("kd", kd)) if text is not None] + gain)
    from maglev_env.channels import SENSORS

    require_choice(sensor, SENSORS, "--sensor")  # before the imports that take long

    from time import perf_counter

    from maglev_env.design.controllers import with_controller
    from maglev_env.design.defaults import with_defaults
    from maglev_env.design.goals import with_goal
    from maglev_env.evaluation.devices import require_device
    from maglev_env.loop.effect import parse_effects
    from maglev_env.rig.rig_file import load_rig
    from maglev_workbench.goal_label import goal_label
    from tuning.sweep import Sweep, default_axes
    from tuning.sweep_run import SPEC, swept_file

    loaded = load_rig(rig)
    if not loaded.controlled:
        raise ValueError(f"rig {loaded.name} has no controlled magnet: there is nothing to sweep")
    loaded = with_goal(with_controller(with_defaults(loaded), controller), goal)
    axes = given or default_axes(loaded)
    if log is None:
        log = not given and all(axis.low > 0 for axis in axes.values())
    plan = Sweep(loaded, axes, log, sobol, parse_effects(effect), seed, sensor, device)
    folder = out or Path(f"sweep-{loaded.name}{goal_label(goal)}")
    require_folder(folder)
    require_apart(json_file, folder, (SPEC, "sweep.nc"))
    require_device(device, sensor)
    # What is asked for is right: now the imports that take longer.
    from maglev_lanes.schedule import workers
    from maglev_workbench.commands.sweep.report import gain_sets, sweep_page, sweep_summary, sweep_tables
    from maglev_workbench.console import console, progress_bar, write_json
    from maglev_workbench.page import write_page
    from tuning.swept_sets import SweptSets

    total = plan.count
    reused = 0
    started = perf_counter()
    with workers(scheduler, threads) as spread, progress_bar() as bar:
        task = bar.add_task(f"sweep {loaded.name}", total=total)

        def advance(count: int, from_disk: bool) -> None:
            nonlocal reused
            reused += count if from_disk else 0
            bar.advance(task, count)

        try:
            file = swept_file(plan, folder, threads, advance, spread, processes=True)
        except KeyboardInterrupt:
            console.print(f"stopped; finished work is in {folder}: run the same command again to continue")
            raise
    seconds = perf_counter() - started
    sets = SweptSets.of_file(file)
    summary = sweep_summary(sets, seconds, reused)
    page = folder / "sweep.html"
    write_page(page, sweep_page(sets), [file, json_file])
    write_json(json_file, summary)
    for part in sweep_tables(sets):
        console.print(part)
    rate = summary["experiments_per_second"]
    console.print(
        f"{gain_sets(summary['n'])}, {summary['feasible']} feasible; {seconds:.1f} s"
        + (f", {rate:.0f} experiments/s" if rate else "")
        + (f", {reused} reused from {folder}" if reused else "")
    )
    console.print(f"data  {file}\npage  {page}")
