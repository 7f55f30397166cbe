"""JSON files, progress bars and the console, for all commands."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.text import Text

from maglev_env.recordings.files import write_text_atomic
from maglev_workbench.heartbeat import stages
from maglev_workbench.printable import printable


class _Printable(Console):
    """A console that shows names and messages of other people's files, and obeys nothing in them."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(printable(segment.text), segment.style)


# Messages hold brackets and colons, as in maglev-workbench[bench] and 1:100:2: no markup, and no pictures for words.
console = _Printable(markup=False, emoji=False)


def marked(mark: str, text: str, style: str = "yellow") -> Text:
    """A line for the console that begins with a mark in a style."""
    return Text.assemble((mark, style), f" {text}")


def write_json(path: Path | None, data: dict[str, Any]) -> None:
    """Write data as strict JSON (without nan), atomically; does nothing if path is None."""
    if path is not None:
        write_text_atomic(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A progress bar on standard error with counts and times.

    If that is not a terminal it shows nothing, and the command says how far it is from time to time.
    """
    error = _Printable(stderr=True)
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=error,
        disable=console.quiet or not error.is_terminal,
    )

    def stage() -> str:
        under_way = [task for task in bar.tasks if not task.finished]
        return ", ".join(
            f"{t.description} {t.completed:g}/{'?' if t.total is None else f'{t.total:g}'}" for t in under_way
        )

    stages.append(stage)
    try:
        with bar:
            yield bar
    finally:
        stages.remove(stage)
