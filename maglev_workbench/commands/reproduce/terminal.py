"""Text for the terminal on one reproduced experiment."""

from rich.markup import escape
from rich.table import Table

from maglev_workbench.commands.reproduce.item import Item, Outcome
from maglev_workbench.commands.reproduce.report import HEAD, cells
from maglev_workbench.console import console


def show(item: Item, outcome: Outcome) -> None:
    """Print its figures beside the published ones, the reasons of differences, and its notes."""
    grid = Table(title=f"{item.name}: {escape(item.title)} ({escape(item.source)})", title_justify="left")
    for heading in HEAD:
        grid.add_column(heading, justify="left" if heading in ("figure", "verdict", "kind") else "right")
    colours = {True: "green", False: "red", None: None}
    for row in outcome.rows:
        grid.add_row(*map(escape, cells(row)), style=colours[row.agrees])
    console.print(grid)
    for one in outcome.tables:
        beside = Table(*one.head, title=escape(one.heading), title_justify="left")
        for line in one.rows:
            beside.add_row(*map(escape, line))
        console.print(beside)
    for row in outcome.rows:
        if row.reason:
            console.print(f"  [bold]{escape(row.name)}[/]: {escape(row.reason)}", highlight=False)
    for sentence in outcome.notes:
        console.print(f"  {escape(sentence)}", highlight=False)
    console.print()
