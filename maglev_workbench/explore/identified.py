"""The identification experiment of the page, in a process of its own.

Compiling a kernel holds the lock of the interpreter, and would stop the curves.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager

from maglev_env.evaluation.identification import Identification
from maglev_env.evaluation.simulated import identify_experiment
from maglev_env.experiment import Experiment
from maglev_lanes.processes import fresh_pool

Identify = Callable[[Experiment, int], Identification]


def identified(experiment: Experiment, axis: int) -> Identification:
    """`identify_experiment` with bands side by side: overlapping ones would cost four times as long."""
    return identify_experiment(experiment, axis, band_overlap=0.0)


@contextmanager
def identifying() -> Iterator[Identify]:
    """`identified` in a process of its own, one experiment at a time, so that the curves keep a core for themselves."""
    with fresh_pool(1) as pool:

        def identify_there(experiment: Experiment, axis: int) -> Identification:
            try:
                return pool.submit(identified, experiment, axis).result()
            except BrokenExecutor:
                raise ValueError("the process of the experiments was ended; start maglev explore again") from None

        yield identify_there
