"""`maglev blind`: checks diagnoses on sealed campaigns of a twin that shares no code with the diagnosis.

This is the table of its commands, each in the folder of its name.
"""

import typer

from maglev_workbench.commands import WholeSentences, add_commands

COMMANDS = ("generate", "answer", "open", "score", "next", "run", "learn")  # in the order of `maglev blind --help`

group = typer.Typer(
    name="blind",
    help="Check diagnoses on campaigns whose truth is sealed: generate, answer, open; or all three by run.",
    no_args_is_help=True,
    cls=WholeSentences,
)
add_commands(group, "maglev_workbench.commands.blind", COMMANDS)
app = typer.Typer()
app.add_typer(group)
