"""`maglev blind open`: scores the answers to a sealed set against its labels."""

import typer

from maglev_workbench.commands.blind.options import FolderArgument, PageDocsOption
from maglev_workbench.options import JsonOption, friendly, require_package

app = typer.Typer()


@app.command("open", epilog="Example: maglev blind open sealed --docs docs/blind.md")
@friendly
def open_(folder: FolderArgument, docs: PageDocsOption = None, json_file: JsonOption = None) -> None:
    """Check the seal, score every answer against the labels, and write the page; the set cannot be used again."""
    if docs is not None:
        require_package("matplotlib")
    from maglev_workbench.commands.blind.sealed_set import made_of

    made_of(folder)  # a folder without a set is told before the long imports
    from maglev_workbench.commands.blind.open.opening import open_folder

    open_folder(folder, docs, json_file)
