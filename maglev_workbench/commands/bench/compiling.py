"""What compiling kernels costs where none is on disk yet."""

import os
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from time import process_time

from maglev_env.evaluation.evaluate import evaluate
from maglev_env.experiment import protocol_experiment
from maglev_env.kernel.advance import kernel
from maglev_env.kernel.lanes import structure_of
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.bench.figures import Figure
from maglev_workbench.commands.bench.kernels import quiet_experiment, variants
from maglev_workbench.commands.bench.timing import Size

_DIRECTORY = "NUMBA_CACHE_DIR"  # where the compiler keeps what it made


def compile_figures(size: Size) -> dict[str, Figure]:
    """Kernels that the variants of this benchmark compile, with and without noise, to statistics and to records;
    processor seconds of their first runs; and seconds of the very first evaluation. In a process of its own."""
    before = os.environ.get(_DIRECTORY)
    with tempfile.TemporaryDirectory(prefix="maglev-bench-") as folder:
        os.environ[_DIRECTORY] = folder
        try:
            with ProcessPoolExecutor(1, get_context("spawn")) as pool:
                first, kernels, seconds = pool.submit(cold_runs, size.compiled).result()
        finally:
            del os.environ[_DIRECTORY]
            if before is not None:
                os.environ[_DIRECTORY] = before
    return {
        "cold_first_evaluation_seconds": Figure(first, "s"),
        "cold_kernels_compiled": Figure(float(kernels), "kernels"),
        "cold_kernel_seconds": Figure(seconds / kernels, "s per kernel"),
    }


def cold_runs(count: int | None = None) -> tuple[float, int, float]:
    """Seconds of the first evaluation; how many kernels all runs need, with `count` variants; and their seconds."""
    noisy, quiet = protocol_experiment(load_rig("hmb_free")), quiet_experiment()
    begun = process_time()
    evaluate([noisy], threads=1)
    first = process_time() - begun
    every = [noisy, quiet, *list(variants(quiet).values())[:count]]
    for e in every:
        short = replace(e, periods=2, transient_periods=0)
        simulate_statistics([short], threads=1)
        simulate_records([short], threads=1)
    return first, len({kernel(structure_of(e)) for e in every}), process_time() - begun
