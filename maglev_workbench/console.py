"""What every command shares: JSON files, progress and the console."""

import json
import os
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from maglev_env.recordings.files import write_text_atomic

console = Console()


def write_json(path: Path | None, data: dict[str, Any]) -> None:
    """Write data as strict JSON (no nan), atomically; nothing when path is None."""
    if path is not None:
        write_text_atomic(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


def require_folder(path: Path | None, option: str) -> None:
    """ValueError before any work when the folder of a file to be written later is missing or read-only."""
    if path is None:
        return
    if path.is_dir():
        raise ValueError(f"{option} {path} is a folder; name a file")
    if not path.parent.is_dir():
        raise ValueError(f"{option} {path}: the folder {path.parent} does not exist; create it or choose another")
    if not os.access(path.parent, os.W_OK):
        raise ValueError(f"{option} {path}: the folder {path.parent} cannot be written to; choose another")


def progress_bar() -> Progress:
    """A bar on standard error with counts and times; silent when not on a terminal."""
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
