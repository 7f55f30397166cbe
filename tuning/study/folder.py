"""Folders of results, with a description of their contents and a lock for one process at a time."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from filelock import FileLock, Timeout

from maglev_env.recordings.files import atomic_file, write_text_atomic

LOCK = "lock"


@contextmanager
def locked(folder: Path, busy: str) -> Iterator[None]:
    """The folder, created if necessary, for this process alone.

    Raises:
        BlockingIOError: Another process has it; the message is `busy`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise BlockingIOError(f"{folder}: {busy}") from None
    try:
        yield
    finally:
        lock.release()


def claim(path: Path, spec: dict[str, Any], kind: str) -> None:
    """Write the description of a folder (JSON data) to path, or check that the existing one is the same.

    Raises:
        ValueError: Something differs (the message names it), or the file does not describe a `kind`.
    """
    if not path.exists():
        write_text_atomic(path, json.dumps(spec, indent=1) + "\n")
        return
    try:
        found = dict(json.loads(path.read_text()))
    except (ValueError, TypeError):
        raise ValueError(f"{path} is not the description of a {kind}; choose another folder") from None
    wanted = json.loads(json.dumps(spec))
    if different := [key for key in {**found, **wanted} if found.get(key) != wanted.get(key)]:
        key = different[0]
        both = "" if isinstance(found.get(key), dict) else f" ({found.get(key)!r}, not {wanted.get(key)!r})"
        raise ValueError(f"{path.parent} holds a {kind} of another {key}{both}; choose another folder")


def save_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write arrays as .npz, completely or not at all."""
    with atomic_file(path) as file:
        np.savez(file, **arrays)


def load_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read what `save_arrays` wrote.

    Raises:
        ValueError: The file is damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            return dict(stored)
    except (BadZipFile, ValueError, EOFError) as error:
        raise ValueError(f"{path} is damaged ({error}); delete it, and it is made again") from error
