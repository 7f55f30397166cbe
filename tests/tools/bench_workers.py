"""Measure how a sweep spreads over workers: bare processes against Dask's, and what the scheduler costs for each task.

Usage: python tests/tools/bench_workers.py [--sets N] [--workers 1 2 4 8] [--rounds N] [--docs FILE]

Gain sets of the quick protocol of the default rig, in the chunks that a sweep sends. Each round lets bare processes
(`concurrent.futures`) and Dask's (`--scheduler local:N`) do all of them, in changing order; both are started and warm
before the clock runs, and a result counts when it has arrived here. What the scheduler carries is measured with tasks
of the same size that compute nothing. From both follows a paper model of a cluster: the time of SETS gain sets is that
of the cores or that of the scheduler, whichever is longer.
"""

import argparse
import os
import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np

from maglev_env import load_rig
from maglev_env.task.protocol import env_protocol
from maglev_lanes.processes import fresh_pool
from maglev_lanes.schedule import Workers, workers
from tuning.axis import Axis
from tuning.sweep import Sweep, points
from tuning.sweep_run import CHUNK, _Chunk

SETS = 10**9
CORES = (1, 10, 100, 1_000, 10_000, 100_000)
EMPTY = 400  # tasks that compute nothing


def chunks_of(count: int) -> list[_Chunk]:
    """What a sweep of that many gain sets sends."""
    rig = load_rig("hmb_free")
    rig = replace(rig, protocol=env_protocol(rig, "quick"))
    axes = {name: Axis(*rig.bounds[name], 2) for name in ("kp", "ki", "kd")}
    sweep = Sweep(rig, axes, sobol=count)
    swept = points(sweep)
    starts = range(0, count, CHUNK)
    return [_Chunk(sweep, start, {name: v[start : start + CHUNK] for name, v in swept.items()}) for start in starts]


def nothing(like: dict[str, tuple[tuple[int, ...], str]], chunk: _Chunk) -> dict[str, np.ndarray]:
    """A task that computes nothing and brings back as much; like: shape and type of every array."""
    return {name: np.zeros(shape, kind) for name, (shape, kind) in like.items()}


def _timed(work: Callable[[], object]) -> float:
    started = perf_counter()
    work()
    return perf_counter() - started


def compared(chunks: Sequence[_Chunk], count: int, rounds: int) -> tuple[float, float]:
    """Shortest seconds of bare processes and of Dask's."""
    with fresh_pool(count) as pool, workers(f"local:{count}") as spread:
        assert spread is not None
        sides = (
            lambda: list(pool.map(_Chunk.columns, chunks)),
            lambda: spread.map(_Chunk.columns, chunks),
        )
        warm = chunks[: 2 * count]
        list(pool.map(_Chunk.columns, warm)), spread.map(_Chunk.columns, warm)
        found: list[list[float]] = [[], []]
        for turn in range(rounds):
            for side in (0, 1) if turn % 2 == 0 else (1, 0):
                found[side].append(_timed(sides[side]))
    return min(found[0]), min(found[1])


def scheduled(chunk: _Chunk, spread: Workers, result: dict[str, np.ndarray]) -> float:
    """Seconds of the scheduler and of this process for a task of the same size."""
    work = partial(nothing, {name: (array.shape, array.dtype.str) for name, array in result.items()})
    spread.map(work, [chunk] * 20)
    return _timed(lambda: spread.map(work, [chunk] * EMPTY)) / EMPTY


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows))


def _hours(seconds: float) -> str:
    for limit, unit, size in ((60, "s", 1), (3600, "min", 60), (86_400, "h", 3600)):
        if seconds < limit:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 86_400:.3g} days"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=16_384)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4, 8])
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--docs", type=Path)
    args = parser.parse_args()
    chunks = chunks_of(args.sets)
    rows, alone = [], np.nan
    for count in args.workers:
        bare, dask = compared(chunks, count, args.rounds)
        alone = bare if count == args.workers[0] else alone
        rows.append((str(count), f"{bare:.2f}", f"{alone / bare:.2f}", f"{dask:.2f}", f"{bare / dask:.2f}"))
        print(rows[-1], flush=True)
    result = chunks[0].columns()
    with workers("local:2") as spread:
        assert spread is not None
        task = scheduled(chunks[0], spread, result)
    sent, back = len(pickle.dumps(chunks[0])), len(pickle.dumps(result))
    core = alone / args.sets * args.workers[0]  # seconds of a core for a gain set
    breaks = CHUNK * core / task
    model = []
    for cores in CORES:
        on_cores, on_scheduler = SETS * core / cores, SETS / CHUNK * task
        bound = "the cores" if on_cores > on_scheduler else "the scheduler"
        model.append((f"{cores:,}", _hours(on_cores), _hours(on_scheduler), bound))
    load = os.getloadavg()[0]
    text = "\n\n".join(
        (
            f"{args.sets:,} gain sets of the quick protocol, in chunks of {CHUNK}; {os.cpu_count()} cores, load "
            f"average {load:.1f} at the end; seconds by the clock, the shortest of {args.rounds} rounds:",
            _table(("workers", "bare processes", "gain", "Dask", "Dask's share of bare speed"), rows),
            f"A chunk sends {sent / 1e3:.3g} kB and brings {back / 1e3:.3g} kB back. A task that computes nothing and "
            f"brings as much takes {1e3 * task:.2g} ms of the scheduler and of the command; a gain set "
            f"{1e3 * core:.2g} ms of a core, a chunk {CHUNK * core:.2g} s: **from {breaks:.0f} workers on they wait "
            f"for the scheduler**. {SETS:,} gain sets on a cluster, by these costs:",
            _table(("cores", "by the cores", "by the scheduler", "bound by"), model),
            f"They bring {SETS / CHUNK * back / 1e12:.2g} TB back, in {SETS // CHUNK:,} chunks.",
        )
    )
    print(text)
    if args.docs is not None:
        args.docs.write_text(text + "\n")


if __name__ == "__main__":
    main()
