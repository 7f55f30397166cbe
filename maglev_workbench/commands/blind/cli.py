"""The `maglev blind` commands: diagnoses checked on sealed campaigns of a twin that shares no code with them."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import JsonOption, SchedulerOption, friendly

app = typer.Typer(
    name="blind",
    help="Check diagnoses on campaigns whose truth is sealed: generate, answer, open; or all three by run.",
    no_args_is_help=True,
)

COUNT = 480
FolderArgument = Annotated[Path, typer.Argument(help="Folder of the sealed set.")]
FolderOption = Annotated[Path, typer.Option("--out", help="Folder of the sealed set.")]
CountOption = Annotated[int, typer.Option(min=1, help="How many campaigns.")]
SetSeedOption = Annotated[int, typer.Option("--seed", min=0, help="Of the whole set: the same seed, the same bytes.")]
ProcessesOption = Annotated[
    int | None, typer.Option(min=1, help="Processes (default: all cores); results do not change.")
]
DocsOption = Annotated[Path | None, typer.Option(help="Also write the page as markdown here, its plot beside it.")]


@app.command(epilog="Example: maglev blind generate --count 480 --seed 7 --out sealed")
@friendly
def generate(
    out: FolderOption,
    seed: SetSeedOption,
    count: CountOption = COUNT,
    processes: ProcessesOption = None,
    json_file: JsonOption = None,
) -> None:
    """Write campaigns of an independent twin, and seal their labels: prints the SHA-256 of what is not to be read."""
    from maglev_workbench.commands.blind import command as command_blind

    command_blind.generate(out, count, seed, processes, json_file)


@app.command(epilog="Example: maglev blind answer sealed")
@friendly
def answer(
    folder: FolderArgument,
    processes: ProcessesOption = None,
    scheduler: SchedulerOption = None,
    json_file: JsonOption = None,
) -> None:
    """Diagnose every campaign of a sealed set, never reading the labels; an interrupted run resumes.

    Campaigns are sent to the workers of a --scheduler: they need not see the folder.
    """
    from maglev_workbench.commands.blind import command as command_blind

    command_blind.answer(folder, processes, scheduler, json_file)


@app.command("open", epilog="Example: maglev blind open sealed --docs docs/blind.md")
@friendly
def open_(folder: FolderArgument, docs: DocsOption = None, json_file: JsonOption = None) -> None:
    """Check the seal, score every answer against the truth, and write the page; from then on the set is spent."""
    from maglev_workbench.commands.blind import command as command_blind

    command_blind.open_folder(folder, docs, json_file)


@app.command(epilog="Example: maglev blind run --seed 7 --out sealed --docs docs/blind.md")
@friendly
def run(
    out: FolderOption,
    seed: SetSeedOption,
    count: CountOption = COUNT,
    quick: Annotated[bool, typer.Option("--quick", help="24 campaigns: shows that it runs, proves little.")] = False,
    processes: ProcessesOption = None,
    scheduler: SchedulerOption = None,
    docs: DocsOption = None,
    json_file: JsonOption = None,
) -> None:
    """Generate, answer and open in one go; what an interrupted run has finished is used.

    A --scheduler answers; its set is generated here.
    """
    from maglev_workbench.commands.blind import command as command_blind

    command_blind.run(out, 24 if quick else count, seed, processes, scheduler, docs, json_file)
