"""Runs of which every channel, or every instrument, has a file of its own: such files are joined on their clocks."""

import csv
import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import numpy as np

from maglev_env.recordings.contents import Contents, contents, rasters, runs
from maglev_env.recordings.files import atomic_file, read_columns
from maglev_env.recordings.guess.columns.columns import guess_columns
from maglev_env.recordings.guess.columns.naming import label_of
from maglev_env.recordings.guess.rate import stated_step
from maglev_env.recordings.guess.recording import RecordingGuess
from maglev_env.recordings.guess.units import header_unit
from maglev_workbench.commands.new.files import JOINED

_TIME = "time [s]"
_ALIKE = 1e-3  # relative difference of two rates that are one
_STRUCTURED = (".mat", ".h5", ".hdf5", ".nc")
_SHARED = 0.8  # of the shorter file's duration that both must cover


@dataclass(frozen=True, eq=False)
class _Part:
    """Columns of one clock (samples,), in s: what each is called, its group or file, and its values (samples,)."""

    clock: np.ndarray
    columns: Sequence[tuple[str, str, np.ndarray]]


@dataclass(frozen=True)
class Joined:
    """One run.

    Attributes:
        parts: Its files; the first holds the displacement.
        columns: By name; the clock, "time [s]", comes first.
        why: What was done, in words.
        run: What the file calls it, where it holds several.
    """

    parts: tuple[Path, ...]
    columns: Mapping[str, np.ndarray]
    why: str
    run: str = ""

    @property
    def name(self) -> str:
        """Of the file that holds the run: what the names of its parts begin with, and which run of a file it is."""
        if self.run:
            return f"{self.parts[0].stem}_{re.sub(r'[^A-Za-z0-9]+', '_', self.run).strip('_')}{JOINED}.csv"
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


def run_of_rasters(file: Path, guess: RecordingGuess) -> Joined | None:
    """A run of which one file holds the motion at one raster and currents at another, each with a time of its own.

    Args:
        file: the file.
        guess: of its columns at the raster that most of them have.

    Returns:
        None where that raster has the motion, the file has no other one, or their clocks do not fit.
    """
    if any(name.startswith(("displacement", "acceleration")) for name in guess.channels):
        return None
    parts = []
    for found in rasters(read_columns(file)):
        guesses = {c.channel: c for c in guess_columns(found) if c.channel}
        time = guesses.pop("time", None)
        if time is not None and guesses:
            part = _Part(found.columns[time.column] * time.scale, [_column(found, c.column) for c in guesses.values()])
            parts.append((part, tuple(guesses)))
    moving = [part for part, channels in parts if any(name.startswith("displacement") for name in channels)]
    if len(parts) < 2 or len(moving) != 1:
        return None
    ordered = [moving[0], *(part for part, _ in parts if part is not moving[0])]
    joined = _at_the_slowest(ordered)
    if joined is None:
        return None
    rates = [1 / float(np.median(np.diff(part.clock))) for part in ordered]
    names = iter([*joined][1:])
    of_each = " and ".join(
        f"{', '.join(next(names) for _ in part.columns)} ({rate:g} Hz)"
        for part, rate in zip(ordered, rates, strict=True)
    )
    return Joined((file,), joined, f"{file.name} holds {of_each}, which are joined on their clocks{_how(rates)}")


def runs_of_file(file: Path) -> list[Joined]:
    """The runs of a file of structs or groups that holds several, each with a motion and a clock; else empty."""
    if file.suffix.lower() not in _STRUCTURED:
        return []
    made = []
    for run, found in runs(read_columns(file)).items():
        guesses = {c.channel: c for c in guess_columns(found) if c.channel}
        time, step = guesses.pop("time", None), stated_step(found.numbers)
        if not any(name.startswith(("displacement", "acceleration")) for name in guesses) or not (time or step):
            return []
        size = next(iter(found.columns.values())).size
        clock = found.columns[time.column] * time.scale if time else np.arange(size) * step[0]
        part = _Part(clock, [_column(found, c.column) for c in guesses.values()])
        columns = dict(zip(_names([part]), (values for *_, values in part.columns), strict=True))
        why = f"{run} of {file.name}, which holds several runs"
        made.append(Joined((file,), {_TIME: clock, **columns}, why, run))
    return made


def split_into_runs(files: Sequence[Path], folder: Path) -> tuple[list[Path], list[Joined]]:
    """The files, with one for each run in place of a file that holds several, and what was written for them."""
    taken: list[Path] = []
    made: list[Joined] = []
    for file in files:
        try:
            found = runs_of_file(file)
        except (OSError, ValueError):  # said where the file is read for itself
            found = []
        taken += [write_joined(run, folder) for run in found] or [file]
        made += found
    return taken, made


def _column(found: Contents, column: str) -> tuple[str, str, np.ndarray]:
    """What a file calls a column without the names of its groups, these groups, and its values."""
    groups, _, name = column.rpartition(".")
    return _called(found, column, name), groups.replace(".", " "), found.columns[column]


def _called(found: Contents, column: str, name: str) -> str:
    """What texts of a file call a column, with its unit in brackets; its name where they say no more than that."""
    if header := found.headers.get(column, ""):
        return header
    label, unit = label_of(column, found)
    if label in re.split(r"[.\[\]]+", column) and unit == header_unit(name)[1]:
        return name
    return f"{label} [{unit.text}]" if unit and unit != header_unit(label)[1] else label


def _words(file: Path) -> set[str]:
    return {w for w in re.split(r"[\W_]+|(?<=[a-z])(?=\d)", file.stem.lower()) if w}


def _joined(files: Sequence[Path], guesses: Mapping[Path, RecordingGuess]) -> Joined | None:
    """The columns of several files at the stamps of the slowest; None where their clocks do not fit."""
    if any(guesses[f].rate.value is None or "time" not in guesses[f].channels for f in files):
        return None
    read = {f: contents(read_columns(f)) for f in files}
    parts = []
    for f in files:
        time = guesses[f].channels["time"]
        used = [c.column for c in guesses[f].columns if c.column != time.column]
        columns = [(_called(read[f], c, c), f.stem, read[f].columns[c]) for c in used]
        parts.append(_Part(read[f].columns[time.column] * time.scale, columns))
    joined = _at_the_slowest(parts)
    if joined is None:
        return None
    rates = [guesses[f].rate.value for f in files]
    of_each = " and ".join(f"{f.name} ({rate:g} Hz)" for f, rate in zip(files, rates, strict=True))
    return Joined(tuple(files), joined, f"{of_each} are joined on their clocks{_how(rates)}{_begun(parts)}")


def _begun(parts: Sequence[_Part]) -> str:
    """What the first stamps of parts say of whether they count from one instant; "" where they are equal and not 0."""
    begins = [float(part.clock[0]) for part in parts]
    step = max(float(np.median(np.diff(part.clock))) for part in parts)
    if np.ptp(begins) > step:
        return f"; they begin {np.ptp(begins):.4g} s apart"
    if max(map(abs, begins)) <= step:
        return "; each clock begins at 0: look whether both were started at one instant, which no file says"
    return ""


def _at_the_slowest(parts: Sequence[_Part]) -> dict[str, np.ndarray] | None:
    """The columns of parts at the stamps of the slowest; None where their clocks do not fit."""
    clocks = [part.clock for part in parts]
    if any(not (np.diff(clock) > 0).all() for clock in clocks):
        return None
    begin, end = max(t[0] for t in clocks), min(t[-1] for t in clocks)
    if end - begin < _SHARED * min(t[-1] - t[0] for t in clocks):
        return None
    at = max(clocks, key=lambda t: float(np.median(np.diff(t))))
    at = at[(at >= begin) & (at <= end)]
    columns = [np.interp(at, part.clock, values) for part in parts for *_, values in part.columns]
    return {_TIME: at, **dict(zip(_names(parts), columns, strict=True))}


def _names(parts: Sequence[_Part]) -> list[str]:
    """What the columns of parts are called: of one name that several have, behind that of the group or file of each."""
    columns = [(name, above.split()) for part in parts for name, above, _ in part.columns]
    often = Counter([_TIME, *(name for name, _ in columns)])
    words = zip(*(above for _, above in columns), strict=False)
    same = len([*takewhile(lambda of_each: len(set(of_each)) == 1, words)])  # the run's, which another run has not
    names = [_TIME]
    for name, above in columns:
        called = " ".join([*above[same:], name]) if often[name] > 1 else name
        while called in names:  # groups may have one name, too
            called = f"other {called}"
        names.append(called)
    return names[1:]


def _how(rates: Sequence[float]) -> str:
    if max(rates) / min(rates) - 1 < _ALIKE:
        return ""
    return f", at the {min(rates):g} Hz of the slowest: the others are read between two samples"


def write_joined(run: Joined, folder: Path) -> Path:
    """Write a run as CSV into a folder.

    Raises:
        ValueError: a file of this name is there, with other contents.
    """
    path = folder / run.name
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(run.columns)  # what a file calls its columns may hold commas and quotes
    # Every digit: a clock that counts from 1970 needs more than ten before its rate shows.
    writer.writerows(np.column_stack(list(run.columns.values())).tolist())
    text = table.getvalue()
    if path.exists() and path.read_text() != text:
        raise ValueError(f"{path} exists and holds something else; move it away, or choose another --out")
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as file:
        file.write(text.encode())
    return path
