"""`maglev export`: models for MATLAB, python-control and any other program."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import EffectOption, friendly, require_choice, require_file

FORMATS = (".mat", ".json", ".py")
app = typer.Typer()


@app.command(epilog="Example: maglev export hmb_free --out plant.mat && maglev export my-rig --out identified.py")
@friendly
def export(
    source: Annotated[
        str,
        typer.Argument(help="Rig (preset, TOML, a diagnosis' corrected.toml), or campaign folder to identify."),
    ],
    out: Annotated[
        Path, typer.Option(help="File to write: .mat (MATLAB v5), .json, or .py (for python-control).")
    ] = Path("models.mat"),
    effect: EffectOption = [],  # noqa: B006
) -> None:
    """Write linear models: of a rig its loop (state space, transfer function, response), of recordings the identified.

    A rig gives plant, controller and closed loop. A campaign gives, for each recording, the measured receptance with
    its variance, the loop gain where it shows, and the mode around the natural frequency. Units and signs stand in the
    file. A rig takes a second, a recording a few.
    """
    require_file(out, "--out")
    require_choice(out.suffix, FORMATS, "--out: the ending")
    from maglev_workbench.commands.export.asked import models_of

    models = models_of(source, effect)
    from maglev_workbench.commands.export.files import WRITERS
    from maglev_workbench.console import console

    WRITERS[out.suffix](out, source, models)
    for one in models:
        console.print(f"{one.name}: {one.about}", soft_wrap=True)
    console.print(f"file  {out}", soft_wrap=True)
