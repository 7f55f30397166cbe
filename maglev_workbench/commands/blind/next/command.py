"""`maglev blind next`: whether the recordings that answers propose decide."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.commands.blind.options import FolderArgument, ProcessesOption
from maglev_workbench.options import JsonOption, friendly

app = typer.Typer()


@app.command("next", epilog="Example: maglev blind next sealed --docs next.md")
@friendly
def next_(
    folder: FolderArgument,
    processes: ProcessesOption = None,
    docs: Annotated[Path | None, typer.Option(help="Also write the table as markdown to this file.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Record what answers to a scored benchmark set ask for, on the true rigs, and diagnose again.

    Of every known effect that was answered by a class or as unknown: up to two recordings, as
    proposed and as drawn from the same menu, until the cause alone is named. A campaign takes
    about a minute of a core; an interrupted run resumes.
    """
    from maglev_workbench.commands.blind.sealed_set import made_of

    made_of(folder)  # a folder without a set is told before the long imports
    from maglev_workbench.commands.blind.next.trying import try_folder

    try_folder(folder, processes, docs, json_file)
