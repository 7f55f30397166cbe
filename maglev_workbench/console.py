"""JSON files, progress bars and the console, for all commands."""

import json
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from maglev_env.recordings.files import write_text_atomic

console = Console()


def write_json(path: Path | None, data: dict[str, Any]) -> None:
    """Write data as strict JSON (without nan), atomically; does nothing if path is None."""
    if path is not None:
        write_text_atomic(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


def progress_bar() -> Progress:
    """A progress bar on standard error with counts and times; it shows nothing if that is not a terminal."""
    error = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=error,
        disable=not error.is_terminal,
    )
