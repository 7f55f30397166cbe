"""`maglev blind score`: scores methods on a set of the benchmark, beside an oracle."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.commands.blind.options import FolderArgument
from maglev_workbench.options import JsonOption, friendly

app = typer.Typer()


@app.command(epilog="Example: maglev blind score sealed their-answers sealed/answers")
@friendly
def score(
    folder: FolderArgument,
    answers: Annotated[
        list[Path] | None, typer.Argument(help="Folders of answers (default: every answers* in the set).")
    ] = None,
    docs: Annotated[Path | None, typer.Option(help="Also write the table as markdown to this file.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Check the seal of a benchmark set and compare methods' answers with the truth and with an oracle.

    The set is opened: it takes no further answers.
    """
    from maglev_workbench.commands.blind.sealed_set import made_of

    made_of(folder)  # a folder without a set is told before the long imports
    from maglev_workbench.commands.blind.score.scoring import score_folder

    score_folder(folder, answers or [], docs, json_file)
