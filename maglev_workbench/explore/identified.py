"""The experiments of the page, in a process of their own.

Compiling a kernel holds the lock of the interpreter, and would stop the curves.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from typing import Any, Protocol, TypeVar

from maglev_env.evaluation.identification import Identification
from maglev_env.evaluation.simulated import identify_experiment
from maglev_env.experiment import Experiment
from maglev_lanes.processes import fresh_pool

Result = TypeVar("Result")


class Run(Protocol):
    """Calls a function, here or elsewhere, with arguments that can be sent to another process."""

    def __call__(self, work: Callable[..., Result], *given: Any) -> Result: ...


def run_here(work: Callable[..., Result], *given: Any) -> Result:
    return work(*given)


def identified(experiment: Experiment, axis: int) -> Identification:
    """`identify_experiment` with bands side by side: overlapping ones would cost four times as long."""
    return identify_experiment(experiment, axis, band_overlap=0.0)


@contextmanager
def other_process() -> Iterator[Run]:
    """A process for experiments, one at a time, so that the curves keep a core for themselves."""
    with fresh_pool(1) as pool:

        def run_there(work: Callable[..., Result], *given: Any) -> Result:
            try:
                return pool.submit(work, *given).result()
            except BrokenExecutor:
                raise ValueError("the process of the experiments was ended; start maglev explore again") from None

        yield run_there
