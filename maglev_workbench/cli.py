"""The `maglev` command: the table of all commands.

Each name is a folder of `maglev_workbench.commands`, whose `command.py` has the command's options and its function. The
function imports what it needs when it is called, so that `--help` is fast.
"""

import gc
import os
from typing import Annotated

import typer

from maglev_workbench.commands import WholeSentences, add_commands

COMMANDS = (  # in the order of `maglev --help`
    "sweep",
    "new",
    "estimate",
    "check",
    "diagnose",
    "simulate",
    "export",
    "runup",
    "bench",
    "reproduce",
    "coverage",
    "effects",
    "explore",
    "tune",
    "compare",
    "train",
    "selfsense",
    "blind",
)

COLLECTED = 200_000, 50, 100  # objects after which the garbage collector looks; and how often at older ones

app = typer.Typer(
    name="maglev",
    help="Tune and identify magnetically levitated rotors: gains in; stiffness, damping and stability out.",
    no_args_is_help=True,
    cls=WholeSentences,
    rich_markup_mode=None,  # which takes as long to import as everything else, and swallows what is in brackets
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
add_commands(app, "maglev_workbench.commands", COMMANDS)


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"maglev-workbench {version('maglev-workbench')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    # numpy reads this when it is imported, which no command has done yet. Matrices are small here, so that several
    # threads wait for one another, and the last bits of results would depend on their number.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # What imports and figures make stays; the collector would look at all of it after every 700 objects.
    gc.set_threshold(*COLLECTED)


if __name__ == "__main__":
    app()
