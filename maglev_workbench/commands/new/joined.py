"""Runs of which every channel, or every instrument, has a file of its own: such files are joined on their clocks."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maglev_env.recordings.contents import contents
from maglev_env.recordings.files import atomic_file, read_columns
from maglev_env.recordings.guess.recording import RecordingGuess
from maglev_workbench.commands.new.files import JOINED

_ALIKE = 1e-3  # relative difference of two rates that are one
_SHARED = 0.8  # of the shorter file's duration that both must cover


@dataclass(frozen=True)
class Joined:
    """One run.

    Attributes:
        parts: Its files; the first holds the displacement.
        columns: By name; the clock, "time [s]", comes first.
        why: What was done, in words.
    """

    parts: tuple[Path, ...]
    columns: Mapping[str, np.ndarray]
    why: str

    @property
    def name(self) -> str:
        """Of the file that holds the run: what the names of its parts begin with."""
        stems = [p.stem for p in self.parts]
        same = next((i for i, letters in enumerate(zip(*stems, strict=False)) if len(set(letters)) > 1), None)
        return f"{stems[0][:same].rstrip('_- .') or stems[0]}{JOINED}.csv"


def runs_of_parts(moving: Mapping[Path, RecordingGuess], still: Mapping[Path, RecordingGuess]) -> list[Joined]:
    """Files that hold how the rotor moves, each with those that hold what else was read in the same run.

    A file belongs to the one whose name has most words in common with its own, where that is one alone, and their
    clocks overlap.

    Args:
        moving: files with a displacement or acceleration.
        still: files without.
    """
    partners: dict[Path, list[Path]] = {}
    for file, guess in still.items():
        if guess.rate.value is None or "time" not in guess.channels:
            continue
        shared = {one: len(_words(one) & _words(file)) for one in moving}
        best = [one for one, count in shared.items() if count == max(shared.values())]
        if len(best) == 1 and (len(moving) == 1 or shared[best[0]]):
            partners.setdefault(best[0], []).append(file)
    found = [_joined([one, *others], {**moving, **still}) for one, others in partners.items()]
    return [one for one in found if one is not None]


def _words(file: Path) -> set[str]:
    return {w for w in re.split(r"[\W_]+|(?<=[a-z])(?=\d)", file.stem.lower()) if w}


def _joined(files: Sequence[Path], guesses: Mapping[Path, RecordingGuess]) -> Joined | None:
    """The columns of several files at the stamps of the slowest; None where their clocks do not fit."""
    if any(guesses[f].rate.value is None or "time" not in guesses[f].channels for f in files):
        return None
    read = {f: contents(read_columns(f)) for f in files}
    clocks = {}
    for f in files:
        time = guesses[f].channels["time"]
        clocks[f] = read[f].columns[time.column] * time.scale
        if not (np.diff(clocks[f]) > 0).all():
            return None
    begin, end = max(t[0] for t in clocks.values()), min(t[-1] for t in clocks.values())
    if end - begin < _SHARED * min(t[-1] - t[0] for t in clocks.values()):
        return None
    slowest = min(files, key=lambda f: guesses[f].rate.value)
    at = clocks[slowest]
    at = at[(at >= begin) & (at <= end)]
    columns: dict[str, np.ndarray] = {"time [s]": at}
    for f in files:
        used = [c for c in guesses[f].columns if c.column != guesses[f].channels["time"].column]
        for column in used:
            name = read[f].headers.get(column.column, column.column).replace(",", " ")
            name = name if name not in columns else f"{f.stem} {name}"
            columns[name] = np.interp(at, clocks[f], read[f].columns[column.column])
    rates = {f: guesses[f].rate.value for f in files}
    of_each = " and ".join(f"{f.name} ({rate:g} Hz)" for f, rate in rates.items())
    alike = max(rates.values()) / min(rates.values()) - 1 < _ALIKE
    how = (
        "" if alike else f", at the {min(rates.values()):g} Hz of the slowest: the others are read between two samples"
    )
    return Joined(tuple(files), columns, f"{of_each} are joined on their clocks{how}")


def write_joined(run: Joined, folder: Path) -> Path:
    """Write a run as CSV into a folder.

    Raises:
        ValueError: a file of this name is there, with other contents.
    """
    path = folder / run.name
    text = ",".join(run.columns) + "\n"
    rows = np.column_stack(list(run.columns.values()))
    text += "\n".join(",".join(f"{v:.10g}" for v in row) for row in rows) + "\n"
    if path.exists() and path.read_text() != text:
        raise ValueError(f"{path} exists and holds something else; move it away, or choose another --out")
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as file:
        file.write(text.encode())
    return path
