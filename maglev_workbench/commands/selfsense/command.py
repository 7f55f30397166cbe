"""`maglev selfsense`: the table of its commands, each in the folder of its name."""

import typer

from maglev_workbench.commands import WholeSentences, add_commands

COMMANDS = (  # in the order of `maglev selfsense --help`
    "demodulate",
    "record",
    "estimate",
    "calibrate",
    "design",
    "rate_limit",
    "noise",
    "robustness",
    "rivals",
    "levitate",
)

group = typer.Typer(
    name="selfsense", help="Estimate the air gap from the coil current alone.", no_args_is_help=True, cls=WholeSentences
)
add_commands(group, "maglev_workbench.commands.selfsense", COMMANDS)
app = typer.Typer()
app.add_typer(group)
