"""`maglev reproduce`: the dissertation's experiments run anew, as tables, a page, JSON and markdown."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from maglev_env.recordings.files import write_text_atomic
from maglev_workbench.commands.reproduce.chapters.item import Item, Outcome
from maglev_workbench.commands.reproduce.chapters.registry import chosen
from maglev_workbench.commands.reproduce.report import (
    HEAD,
    cells,
    reproduce_json,
    reproduce_markdown,
    reproduce_page,
    summary,
)
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from maglev_workbench.page import write_page

PAGE = "reproduce.html"


def run(names: Sequence[str], out: Path, docs: Path | None, json_file: Path | None, seed: int) -> None:
    """See `maglev_workbench.cli.reproduce`. Nothing is written before the last item is done."""
    items = chosen(names)
    require_folder(json_file, "--json")
    require_folder(docs, "--docs")
    if out.exists() and not out.is_dir():
        raise ValueError(f"--out {out} is a file; name a folder")
    outcomes = []
    with progress_bar() as bar:
        task = bar.add_task("", total=len(items))
        for item in items:
            bar.update(task, description=item.name)
            outcomes.append(item.run(seed))
            bar.advance(task)
    done = list(zip(items, outcomes, strict=True))
    for item, outcome in done:
        _show(item, outcome)
    out.mkdir(parents=True, exist_ok=True)
    write_page(out / PAGE, reproduce_page(done, seed))
    write_json(json_file, reproduce_json(done, seed))
    if docs is not None:
        write_text_atomic(docs, reproduce_markdown(done, seed))
    console.print(f"{summary(done)}\npage  {out / PAGE}")


def _show(item: Item, outcome: Outcome) -> None:
    grid = Table(title=f"{item.name}: {escape(item.title)} ({escape(item.source)})", title_justify="left")
    for heading in HEAD:
        grid.add_column(heading, justify="left" if heading in ("figure", "verdict") else "right")
    colours = {True: "green", False: "red", None: None}
    for row in outcome.rows:
        grid.add_row(*map(escape, cells(row)), style=colours[row.agrees])
    console.print(grid)
    for row in outcome.rows:
        if row.reason:
            console.print(f"  [bold]{escape(row.name)}[/]: {escape(row.reason)}", highlight=False)
    for sentence in outcome.notes:
        console.print(f"  {escape(sentence)}", highlight=False)
    console.print()
