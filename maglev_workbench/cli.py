"""The `maglev` command: the table of all commands.

Each name is a folder of `maglev_workbench.commands`, whose `command.py` has the command's options and its function. The
function imports what it needs when it is called, so that `--help` is fast.
"""

import typer

from maglev_workbench.commands import add_commands

COMMANDS = (  # in the order of `maglev --help`
    "sweep",
    "new",
    "estimate",
    "check",
    "diagnose",
    "simulate",
    "runup",
    "bench",
    "reproduce",
    "coverage",
    "effects",
    "tune",
    "compare",
    "train",
    "selfsense",
    "blind",
)

app = typer.Typer(
    name="maglev",
    help="Tune and identify magnetically levitated rotors: gains in; stiffness, damping and stability out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
add_commands(app, "maglev_workbench.commands", COMMANDS)


if __name__ == "__main__":
    app()
