"""Options that several `maglev blind` commands share."""

from pathlib import Path
from typing import Annotated

import typer

COUNT = 480
FolderArgument = Annotated[Path, typer.Argument(help="Folder of the sealed set.")]
FolderOption = Annotated[Path, typer.Option("--out", help="Folder of the sealed set.")]
CountOption = Annotated[int, typer.Option(min=1, help="How many campaigns.")]
SetSeedOption = Annotated[int, typer.Option("--seed", min=0, help="Of the whole set: the same seed, the same bytes.")]
ProcessesOption = Annotated[
    int | None, typer.Option(min=1, help="Processes (default: all cores); results do not change.")
]
PageDocsOption = Annotated[Path | None, typer.Option(help="Also write the page as markdown here, its plot beside it.")]
