"""`maglev runup`: a rotor at a ladder of increasing speeds; results as a table, a page and JSON."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import (
    JsonOption,
    SeedOption,
    SensorOption,
    ThreadsOption,
    friendly,
    require_choice,
    require_folder,
    require_package,
)

PAGE = "runup.html"
PICTURES = (".png", ".svg", ".pdf")
app = typer.Typer()


@app.command(
    epilog="Examples: maglev runup --speeds 0:14000:500 --gains tilt.kd=6 --out my-runup; "
    "maglev runup --sensor self_sensing --speeds 0:14000:2000"
)
@friendly
def runup(
    rotor: Annotated[str, typer.Option(help="Preset (pump) or a rotor TOML.")] = "pump",
    speeds: Annotated[str, typer.Option(help="lo:hi:step in rpm, or one speed.")] = "0:14000:500",
    kp: Annotated[float | None, typer.Option(help="A/m, of both controllers (default: the rotor's).")] = None,
    ki: Annotated[float | None, typer.Option(help="A/m, of both controllers.")] = None,
    kd: Annotated[float | None, typer.Option(help="A s/m, of both controllers.")] = None,
    gains: Annotated[
        list[str], typer.Option(help="One gain of one controller, e.g. translation.kp=9000; repeat.")
    ] = [],  # noqa: B006
    rejection: Annotated[
        float | None, typer.Option(help="Reject unbalance forces at this rate, 1/s (default: the rotor's own).")
    ] = None,
    sensor: SensorOption = "probe",
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the page.")] = None,
    json_file: JsonOption = None,
    picture: Annotated[Path | None, typer.Option(help="Also draw the response to this .png, .svg or .pdf.")] = None,
) -> None:
    """Run a levitated rotor up: displacement, power of coils and motor, touchdowns and margins at each speed."""
    from dataclasses import replace
    from time import perf_counter

    from maglev_env.channels import SENSORS

    require_choice(sensor, SENSORS, "--sensor")
    from maglev_env.rotor.rotor import load_rotor
    from maglev_workbench.commands.runup.asked import check_reach, parse_speeds, with_chosen_gains, with_rejection

    ladder = parse_speeds(speeds)
    from maglev_workbench.commands.runup.figures import save_picture
    from maglev_workbench.commands.runup.report import run_up_json, run_up_page, run_up_table, summary
    from maglev_workbench.commands.runup.sensing import sensing_tables
    from maglev_workbench.commands.runup.study import report
    from maglev_workbench.console import console, write_json
    from maglev_workbench.page import write_page

    chosen = with_rejection(load_rotor(rotor), rejection)
    chosen = replace(with_chosen_gains(chosen, {"kp": kp, "ki": ki, "kd": kd}, gains), sensor=sensor)
    check_reach(chosen, ladder)
    folder = out or Path(f"runup-{chosen.name}")
    require_folder(folder)
    if picture is not None and picture.suffix not in PICTURES:
        raise ValueError(f"--picture {picture}: end it in {', '.join(PICTURES)}")
    if picture is not None:
        require_package("matplotlib")
    started = perf_counter()
    found = report(chosen, ladder, seed, threads)
    seconds = perf_counter() - started
    folder.mkdir(parents=True, exist_ok=True)
    write_page(folder / PAGE, run_up_page(found), [json_file])
    write_json(json_file, run_up_json(found))
    if picture is not None:
        save_picture(found, picture)
    for one in (run_up_table(found), *sensing_tables(found)):
        console.print(one)
    touched = any(found.touchdowns)
    console.print(summary(found), style="bold red" if touched else None, highlight=False)
    console.print(f"{seconds:.1f} s\npage  {folder / PAGE}")
