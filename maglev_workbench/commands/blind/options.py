"""Options that several `maglev blind` commands share."""

from pathlib import Path
from typing import Annotated

import typer

COUNT = 480
FolderArgument = Annotated[Path, typer.Argument(help="Folder of the sealed set.")]
FolderOption = Annotated[Path, typer.Option("--out", help="Folder of the sealed set.")]
CountOption = Annotated[int, typer.Option(min=1, max=100_000, help="Number of campaigns.")]
SetSeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed, which determines every byte of the set.")]
BenchmarkOption = Annotated[
    bool, typer.Option("--benchmark", help="The benchmark's rigs, forms and unknowns (docs/benchmark.md).")
]
ProcessesOption = Annotated[
    int | None, typer.Option(min=1, help="Processes (default: all cores); results do not change.")
]
PageDocsOption = Annotated[Path | None, typer.Option(help="Also write the page as markdown to this file.")]
