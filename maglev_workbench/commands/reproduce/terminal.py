"""Text for the terminal on one reproduced experiment."""

from rich.table import Table

from maglev_workbench.commands.reproduce.item import Item, Outcome
from maglev_workbench.commands.reproduce.report import HEAD, cells
from maglev_workbench.console import console, marked


def show(item: Item, outcome: Outcome) -> None:
    """Print its figures beside the published ones, the reasons of differences, and its notes."""
    grid = Table(title=f"{item.name}: {item.title} ({item.source})", title_justify="left")
    for heading in HEAD:
        grid.add_column(heading, justify="left" if heading in ("figure", "verdict", "kind") else "right")
    colours = {True: "green", False: "red", None: None}
    for row in outcome.rows:
        grid.add_row(*cells(row), style=colours[row.agrees])
    console.print(grid)
    for one in outcome.tables:
        beside = Table(*one.head, title=one.heading, title_justify="left")
        for line in one.rows:
            beside.add_row(*line)
        console.print(beside)
    for row in outcome.rows:
        if row.reason:
            console.print(marked(f"  {row.name}:", row.reason, "bold"))
    for sentence in outcome.notes:
        console.print(f"  {sentence}", highlight=False)
    console.print()
