"""Folders of results, with a description of their contents and a lock for one process at a time."""

import json
import os
import shlex
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from maglev_env.recordings.files import atomic_file, write_text_atomic

LOCK = "lock"  # locked while a process works in the folder; the system unlocks it when that process ends, however
HOLDER = "lock.json"  # says which process that is


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """The folder, created if necessary, for this process alone.

    Raises:
        BlockingIOError: Another process works there; the message says which, and since when.
    """
    from filelock import FileLock, Timeout  # takes long to import

    folder.mkdir(parents=True, exist_ok=True)
    lock, holder = FileLock(folder / LOCK, timeout=0), folder / HOLDER
    try:
        lock.acquire()
    except Timeout:
        raise BlockingIOError(
            f"{folder}: another process works there{_who(holder)}; wait for it, or choose another folder"
        ) from None
    try:
        command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
        since = datetime.now().isoformat(" ", "seconds")
        mine = {"process": os.getpid(), "host": socket.gethostname(), "command": command, "since": since}
        write_text_atomic(holder, json.dumps(mine) + "\n")
        yield
    finally:
        holder.unlink(missing_ok=True)
        lock.release()


def _who(holder: Path) -> str:
    """Which process holds a folder, as far as it has said so."""
    try:
        found = json.loads(holder.read_text())
        return f" ({found['command'][:200]}, process {found['process']} on {found['host']}, since {found['since']})"
    except (OSError, ValueError, TypeError, KeyError):
        return ""


def is_empty(folder: Path) -> bool:
    """Whether a folder holds nothing but its lock and, from a process that was killed, unfinished files."""
    return all(path.name in (LOCK, HOLDER) or path.name.startswith(".") for path in folder.iterdir())


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
    except (ValueError, TypeError):  # no JSON, or no object
        raise ValueError(f"{path} is not the description of a {kind}; choose another folder") from None
    wanted = json.loads(json.dumps(spec))
    if different := [key for key in {**found, **wanted} if found.get(key) != wanted.get(key)]:
        key = different[0]
        if key == "version":
            raise ValueError(
                f"{path.parent} holds a {kind} of another version of maglev ({found.get(key)!r}, not "
                f"{wanted.get(key)!r}); go on with that version, or choose another folder"
            )
        what = _difference(key, found.get(key), wanted.get(key))
        raise ValueError(f"{path.parent} holds a {kind} of another {what}; choose another folder")


def _difference(key: str, found: Any, wanted: Any) -> str:
    """What differs between two values of a key, in words; of two tables, what differs first within them.

    A goal stands in the target of its rig, and is no other rig.
    """
    if isinstance(found, dict) and isinstance(wanted, dict):
        first, path = key, []
        while isinstance(found, dict) and isinstance(wanted, dict):
            different = [name for name in found if name in wanted and found[name] != wanted[name]]
            if not different:
                return f"{first}, whose {' '.join(path) or 'entries'} differ"
            path.append(different[0])
            found, wanted = found[different[0]], wanted[different[0]]
        if path[-1] != "goal":
            return f"{first}, whose {' '.join(path)} is {found!r}, not {wanted!r}"
        key = "goal"
    return f"{key} ({found!r}, not {wanted!r})"


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
