"""A folder for every command, with the command's name; its `command.py` has a typer application named `app`."""

from collections.abc import Sequence
from importlib import import_module

import typer


def add_commands(app: typer.Typer, package: str, names: Sequence[str]) -> None:
    """Add the commands of these folders to an application.

    Args:
        app: the application to which they are added.
        package: the package that contains the folders.
        names: their names, in the order of the help.
    """
    for name in names:
        app.add_typer(import_module(f"{package}.{name}.command").app)
