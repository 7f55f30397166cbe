"""`maglev runup`: a rotor run up through a ladder of speeds, as a table, a page and JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from math import isfinite
from pathlib import Path
from time import perf_counter

import numpy as np
from rich.markup import escape

from maglev_env.loop.gains import Gains
from maglev_env.rotor.rotor import Rotor, load_rotor
from maglev_workbench.commands.runup.figures import save_picture
from maglev_workbench.commands.runup.report import run_up_json, run_up_page, run_up_table, summary
from maglev_workbench.commands.runup.study import report
from maglev_workbench.console import console, require_folder, write_json
from maglev_workbench.page import write_page

PAGE = "runup.html"
PICTURES = (".png", ".svg", ".pdf")
MOST_SPEEDS = 2000


def run(
    source: str,
    speeds: str,
    gains: Mapping[str, float | None],
    single: Sequence[str],
    seed: int,
    threads: int | None,
    out: Path | None,
    json_file: Path | None,
    picture: Path | None,
) -> None:
    """See `maglev_workbench.cli.runup`."""
    rotor = with_chosen_gains(load_rotor(source), gains, single)
    ladder = parse_speeds(speeds)
    check_reach(rotor, ladder)
    folder = out or Path(f"runup-{rotor.name}")
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out {folder} is a file; name a folder")
    require_folder(json_file, "--json")
    require_folder(picture, "--picture")
    if picture is not None and picture.suffix not in PICTURES:
        raise ValueError(f"--picture {picture}: end it in {', '.join(PICTURES)}")
    started = perf_counter()
    found = report(rotor, ladder, seed, threads)
    seconds = perf_counter() - started
    folder.mkdir(parents=True, exist_ok=True)
    write_page(folder / PAGE, run_up_page(found))
    write_json(json_file, run_up_json(found))
    if picture is not None:
        save_picture(found, picture)
    console.print(run_up_table(found))
    touched = any(found.touchdowns)
    console.print(escape(summary(found)), style="bold red" if touched else None, highlight=False)
    console.print(f"{seconds:.1f} s\npage  {folder / PAGE}")


def parse_speeds(text: str) -> np.ndarray:
    """Speeds (n,) rpm of lo:hi:step, both ends included, or of one value. ValueError says what to write."""
    try:
        values = [float(part) for part in text.split(":")]
    except ValueError:
        values = []
    if len(values) not in (1, 3) or not all(map(isfinite, values)):
        raise ValueError(f"--speeds {text!r}: write lo:hi:step in rpm, e.g. 0:14000:500, or one speed")
    if len(values) == 1:
        return np.array(values)
    low, high, step = values
    if not (step > 0 and high >= low):
        raise ValueError(f"--speeds {text!r}: the step must be above 0 and lo at most hi")
    count = int((high - low) / step * (1 + 1e-12)) + 1
    if count > MOST_SPEEDS:
        raise ValueError(f"--speeds {text!r}: {count} speeds; take a larger step, {MOST_SPEEDS} at most")
    return low + step * np.arange(count)


def with_chosen_gains(rotor: Rotor, gains: Mapping[str, float | None], single: Sequence[str]) -> Rotor:
    """The rotor with gains replaced in both controllers, then single ones, as controller.gain=value.

    ValueError for what is not a controller or gain of the rotor, or not a number.
    """
    both = {name: value for name, value in gains.items() if value is not None}
    chosen = {name: replace(old, **both) for name, old in rotor.gains.items()}
    known = [f.name for f in fields(Gains)]
    for text in single:
        where, equals, value = text.partition("=")
        controller, dot, name = where.partition(".")
        if not (equals and dot) or controller not in chosen or name not in known:
            raise ValueError(
                f"--gains {text!r}: write controller.gain=value with a controller of {', '.join(chosen)} and a gain of "
                f"{', '.join(known)}"
            )
        try:
            chosen[controller] = replace(chosen[controller], **{name: float(value)})
        except ValueError as error:
            raise ValueError(f"--gains {text!r}: {error}") from None
    return replace(rotor, gains=chosen)


def check_reach(rotor: Rotor, speeds: np.ndarray) -> None:
    """ValueError when the rotor's motor does not hold one of the speeds (rpm)."""
    if rotor.motor is None:
        return
    try:
        rotor.motor.current(float(abs(speeds).max()) * np.pi / 30)
    except ValueError as error:
        raise ValueError(
            f"{error}; lower --speeds, or give [motor] of the rotor's TOML more torque or less drag"
        ) from None
