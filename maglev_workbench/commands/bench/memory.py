"""Memory of evaluations, in a process of its own, and of a block of lanes."""

import sys
import tracemalloc
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

from maglev_env.evaluation.evaluate import evaluate
from maglev_env.experiment import protocol_experiment
from maglev_env.kernel.lanes import lane_batch
from maglev_env.kernel.simulate import block_periods
from maglev_env.rig.rig_file import load_rig
from maglev_lanes.layout import LANES
from maglev_workbench.commands.bench.figures import Figure
from maglev_workbench.commands.bench.kernels import quiet_experiment
from maglev_workbench.commands.bench.timing import Size

_MB = 1e6


def memory_figures(size: Size) -> dict[str, Figure]:
    """Peak memory of evaluating few and many gain sets on one thread, as allocated by numpy and Python.

    peak_rss_growth is the growth of the process' peak resident memory from the smaller to the larger evaluation.
    """
    few, many = size.memory_sets
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:  # this process' own peak may hide that of an evaluation
        peaks, growth = pool.submit(evaluation_peaks, (few, many)).result()
    found = {
        f"peak_memory_{n}_gain_sets_mb": Figure(peak / _MB, "MB") for n, peak in zip((few, many), peaks, strict=True)
    }
    found[f"peak_memory_{many}_over_{few}_gain_sets"] = Figure(peaks[1] / peaks[0], "ratio")
    if growth is not None:
        found[f"peak_rss_growth_{few}_to_{many}_gain_sets_mb"] = Figure(growth / _MB, "MB", None)
    return found | block_figures()


def evaluation_peaks(sets: tuple[int, int]) -> tuple[list[int], int | None]:
    """Peak bytes that each evaluation allocates, and growth of the peak resident memory from the first to the second.

    The latter is None if the system does not give it.
    """
    experiment = protocol_experiment(load_rig("hmb_free"))
    evaluate([experiment], threads=1)  # compiles
    peaks, resident = [], []
    for n in sets:
        batch = [replace(experiment, seed=i) for i in range(n)]
        tracemalloc.start()
        evaluate(batch, threads=1)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        resident.append(_peak_resident())
    return peaks, None if None in resident else resident[1] - resident[0]


def _peak_resident() -> int | None:
    """Bytes."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def block_figures() -> dict[str, Figure]:
    """Bytes per lane of a block: its state while it runs, and its output of one period."""
    e = quiet_experiment()
    batch = lane_batch([e])
    held = batch.rows.nbytes + batch.seeds.nbytes + batch.history_length * batch.rows.itemsize
    (periods,) = block_periods([e])
    return {
        "block_state_bytes_per_lane": Figure(float(held), "B"),
        "block_output_bytes_per_lane": Figure(next(periods).nbytes / LANES, "B"),
    }
