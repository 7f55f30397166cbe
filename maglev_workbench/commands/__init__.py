"""A folder for every command, with the command's name; its `command.py` has a typer application named `app`."""

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup


def add_commands(app: typer.Typer, package: str, names: Sequence[str]) -> None:
    """Add the commands of these folders to an application.

    Args:
        app: the application to which they are added.
        package: the package that contains the folders.
        names: their names, in the order of the help.
    """
    for name in names:
        app.add_typer(import_module(f"{package}.{name}.command").app)


class WholeSentences(TyperGroup):
    """A group of commands whose help has the whole first sentence of each, which would otherwise end in "..."."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        rows = [(name, command.get_short_help_str(limit=1000)) for name, command in self.commands.items()]
        with formatter.section("Commands"):
            formatter.write_dl(rows)
