"""Runs of sweeps: gain sets evaluated chunk by chunk into a folder, from which an interrupted run goes on."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.evaluation.devices import ON_GPU
from maglev_env.evaluation.evaluation import Evaluation
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.loop.gains import gain_values, of_axis
from maglev_env.recordings.result_folder import claim, is_empty, load_arrays, locked, save_arrays
from maglev_lanes.processes import beside_others
from maglev_lanes.threads import cores, one_ahead
from tuning.sweep import Sweep, controllers, description, points
from tuning.sweep_file import read_sweep, write_sweep

if TYPE_CHECKING:
    import xarray as xr

    from maglev_lanes.schedule import Workers
    from maglev_lanes.shared_pool import SharedPool

CHUNK = 256  # gain sets that are stored together
_GROUPS = 4  # of ON_GPU, evaluated together: each is simulated while the one before is judged
JUDGED_APART = 4096  # gain sets of a GPU from which on processes judge them, which take seconds to start
# Gain sets from which on processes evaluate them on this machine's cores. They take a second to start and share no lock
# of the interpreter, for which threads wait most of the time where an experiment is short.
IN_PROCESSES = 4096
SPEC = "sweep.json"


def run_sweep(
    sweep: Sweep,
    out: Path,
    threads: int | None = None,
    progress: Callable[[int, bool], None] | None = None,
    workers: "Workers | None" = None,
    processes: bool = False,
) -> "xr.Dataset":
    """Run or resume a sweep in a folder.

    Finished chunks are reused. An interrupted sweep, and one whose chunks workers made, equal an uninterrupted one bit
    for bit.

    Args:
        sweep: The sweep.
        out: Folder of the results.
        threads: Number of threads or processes; None for all cores.
        progress: Called with (experiments, reused).
        workers: Where to run.
        processes: Spread a large sweep over processes, which is faster than threads. Each process runs the script that
            calls this once more at its start, but for what stands below `if __name__ == "__main__":`. The script needs
            that line.

    Returns:
        Dataset with the dimensions experiment and band, and the gains as coordinates; of more than LARGE experiments it
        stays in its file until something is read.

    Raises:
        ValueError: `out` holds another sweep, or the device is not there, or workers are given with it.
        BlockingIOError: Another process works on it.
        BrokenExecutor: A process was ended from outside, or the script lacks the line above.
        OSError: `out` cannot be written.
    """
    return read_sweep(swept_file(sweep, out, threads, progress, workers, processes))


def swept_file(
    sweep: Sweep,
    out: Path,
    threads: int | None = None,
    progress: Callable[[int, bool], None] | None = None,
    workers: "Workers | None" = None,
    processes: bool = False,
) -> Path:
    """As `run_sweep`, but returns the path of the dataset's file."""
    with locked(out):
        return _run(sweep, out, threads, progress or (lambda n, reused: None), workers, processes)


def _run(sweep, out, threads, advance, workers, processes) -> Path:  # see run_sweep
    if sweep.device != "cpu" and workers is not None:
        raise ValueError(f"sweep: device {sweep.device} is of this machine: leave out the scheduler, or use cpu")
    if not (out / SPEC).exists() and not is_empty(out):
        raise ValueError(f"{out} is not empty and holds no sweep; choose another --out")
    swept, n = points(sweep), sweep.count
    claim(out / SPEC, description(sweep, n), "sweep")
    chunks = out / "chunks"
    chunks.mkdir(exist_ok=True)
    paths = {start: chunks / f"{start:07d}.npz" for start in range(0, n, CHUNK)}
    todo = []
    for start, path in paths.items():
        own = {name: column[start : start + CHUNK] for name, column in swept.items()}
        if not path.exists():
            todo.append(_Chunk(sweep, start, own))
            continue
        load_arrays(path)  # a damaged one is told before the work, not behind it
        advance(min(CHUNK, n - start), True)
    for chunk, columns in _made(todo, threads, lambda n: advance(n, False), workers, processes):
        save_arrays(paths[chunk.start], columns)
    made_by = json.loads((out / SPEC).read_text())
    attributes = {k: v if isinstance(v, str) else json.dumps(v) for k, v in made_by.items()}
    gains = {name: np.full(n, value) for name, value in gain_values(of_axis(sweep.rig.gains, 0)).items()} | swept
    temporary = out / "sweep.part"
    try:
        write_sweep(temporary, map(load_arrays, paths.values()), gains, attributes)
        temporary.replace(out / "sweep.nc")
    finally:
        temporary.unlink(missing_ok=True)
    return out / "sweep.nc"


@dataclass(frozen=True)
class _Chunk:
    """Neighbouring gain sets of a sweep, and the number of the first one, from which their noise is drawn."""

    sweep: Sweep
    start: int
    gains: Mapping[str, np.ndarray]

    def __len__(self) -> int:
        return len(next(iter(self.gains.values())))

    def experiments(self) -> list[Experiment]:
        """Of the gain sets, in order."""
        s = self.sweep
        return [
            protocol_experiment(s.rig, gains, s.effects, (s.seed, i), s.sensor)
            for i, gains in enumerate(controllers(s, self.gains), self.start)
        ]

    def columns(self) -> dict[str, np.ndarray]:
        """All arrays of their evaluation, on one thread."""
        from maglev_env.evaluation.evaluate import evaluate  # takes long to import

        return _columns(evaluate(self.experiments(), 1))


def _made(
    chunks: Sequence[_Chunk],
    threads: int | None,
    progress: Callable[[int], None],
    workers: "Workers | None",
    processes: bool,
) -> Iterator[tuple[_Chunk, dict[str, np.ndarray]]]:
    """Chunks and their columns as they are finished."""
    if workers is None:
        # A chunk alone would keep two threads busy.
        on_cpu, many = bool(chunks) and chunks[0].sweep.device == "cpu", threads or cores()
        apart = processes and many > 1 and sum(map(len, chunks)) >= (IN_PROCESSES if on_cpu else JUDGED_APART)
        if on_cpu and apart:
            for i, columns in beside_others(_Chunk.columns, chunks, many, _ready):
                yield chunks[i], columns
                progress(len(chunks[i]))
            return
        size = many if on_cpu else _GROUPS * ON_GPU // CHUNK
        parts = (chunks[start : start + size] for start in range(0, len(chunks), size))
        made = one_ahead((part, [e for chunk in part for e in chunk.experiments()]) for part in parts)
        with _judges(many) if apart else nullcontext() as judges:
            for part, experiments in made:
                yield from _together(part, experiments, threads, progress, judges)
        return
    for i, columns in workers.each(_Chunk.columns, chunks):
        yield chunks[i], columns
        progress(len(chunks[i]))  # after the caller has stored the chunk


def _ready() -> None:
    """Import, in another process, what it needs."""
    from maglev_env.evaluation.judging import ready

    ready()


def _judges(processes: int) -> "AbstractContextManager[SharedPool]":
    """Processes that judge what a GPU simulates: threads would wait for one another's turn with the interpreter."""
    from maglev_env.evaluation.judging import ready
    from maglev_lanes.shared_pool import shared_pool

    return shared_pool(processes, ready)


def _together(
    chunks: Sequence[_Chunk],
    experiments: Sequence[Experiment],
    threads: int | None,
    progress: Callable[[int], None],
    judges: "SharedPool | None",
) -> Iterator[tuple[_Chunk, dict[str, np.ndarray]]]:
    """Chunks and their columns, evaluated together: a chunk is too little for many threads and for a GPU."""
    from maglev_env.evaluation.evaluate import evaluate

    whole = _columns(evaluate(experiments, threads, progress, device=chunks[0].sweep.device, judges=judges))
    bands, stop = whole.pop("bands"), 0
    for chunk in chunks:
        start, stop = stop, stop + len(chunk)
        own = slice(start, stop)
        yield chunk, {"bands": bands} | {name: column[own] for name, column in whole.items()}


_NAMES = {  # what stands before and behind the names of a field
    "terms": ("term_", ""), "required": ("required_", ""), "required_low": ("required_", "_low"),
    "required_high": ("required_", "_high"), "between_lines": ("between_lines_", ""),
}  # fmt: skip


def _columns(e: Evaluation) -> dict[str, np.ndarray]:
    """Every array of an evaluation under one flat name."""
    columns: dict[str, np.ndarray] = {}
    for f in fields(Evaluation):
        value = getattr(e, f.name)
        named = value if isinstance(value, dict) else {f.name: value}
        head, tail = _NAMES.get(f.name, ("", ""))
        columns |= {head + name + tail: array for name, array in named.items()}
    return columns
