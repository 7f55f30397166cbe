"""`maglev export`: models for MATLAB, python-control and any other program, and studies for Optuna's dashboard."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import EffectOption, friendly, require_choice, require_file, require_package

FORMATS = (".mat", ".json", ".py", ".db")
STUDIES = ".db"
app = typer.Typer()


@app.command(epilog="Example: maglev export hmb_free --out plant.mat && maglev export my-rig --out identified.py")
@friendly
def export(
    source: Annotated[
        str,
        typer.Argument(
            help="Rig (preset, TOML, a diagnosis' corrected.toml), campaign folder to identify, or a study."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            help="File to write: .mat (MATLAB v5), .json, or .py (for python-control); of a study .db (for Optuna)."
        ),
    ] = Path("models.mat"),
    effect: EffectOption = [],  # noqa: B006
) -> None:
    """Write linear models of a rig or of recordings for other programs, or a study for Optuna's dashboard.

    A rig gives plant, controller and closed loop. A campaign gives, for each recording, the measured receptance with
    its variance, the loop gain where it shows, and the mode around the natural frequency. Units and signs stand in the
    file. A rig takes a second, a recording a few. A study is added to an Optuna storage of its experiments, which may
    hold others.
    """
    require_file(out, "--out")
    require_choice(out.suffix, FORMATS, "--out: the ending")
    from maglev_workbench.console import console

    if out.suffix == STUDIES:
        require_package("optuna")
        if effect:
            raise ValueError("--effect goes with a rig; a study has the effects that it was tuned with")
        from maglev_workbench.commands.export.study import add_study

        found = add_study(Path(source), out)
        console.print(f"{found}\nfile  {out}\nsee   optuna-dashboard sqlite:///{out}", soft_wrap=True)
        return
    from maglev_workbench.commands.export.asked import models_of

    models = models_of(source, effect)
    from maglev_workbench.commands.export.files import WRITERS

    WRITERS[out.suffix](out, source, models)
    for one in models:
        console.print(f"{one.name}: {one.about}", soft_wrap=True)
    console.print(f"file  {out}", soft_wrap=True)
