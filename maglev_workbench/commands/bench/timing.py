"""Timing: the best of several repeats, alternating with the references."""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from math import inf
from time import perf_counter
from typing import TypeVar

from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import block_periods

Name = TypeVar("Name", bound=Hashable)
ENOUGH = 8.0  # s


@dataclass(frozen=True)
class Size:
    """Amount of work for each figure; more of it reduces the scatter.

    The fields are: lanes that are simulated, or gain sets that are evaluated, together; repeats of each timing;
    xy_lanes for the x-y estimators, which are the slowest; seconds of the record that is not periodic; gain sets of the
    smaller and the larger evaluation whose memory is measured; variants of the kernel that are compiled, None for all.
    """

    lanes: int = 64
    repeats: int = 5
    xy_lanes: int = 4
    record_seconds: float = 60.0
    memory_sets: tuple[int, int] = (256, 512)
    compiled: int | None = None


def alternately(works: Mapping[Name, Callable[[], object]], repeats: int) -> dict[Name, float]:
    """Shortest time (s) of each function; they alternate, so that changes of the machine's speed affect all equally.

    After ENOUGH seconds the repeats end (there are at least two), so that a slow machine does not measure for minutes.
    """
    best, begun = dict.fromkeys(works, inf), perf_counter()
    for done in range(repeats):
        if done >= 2 and perf_counter() - begun > ENOUGH:
            break
        for name, work in works.items():
            start = perf_counter()
            work()
            best[name] = min(best[name], perf_counter() - start)
    return best


def stepper(experiments: list[Experiment], calls: int) -> Callable[[], None]:
    """The kernel alone on one core: each of so many calls advances all experiments by one period.

    Compilation, allocation and the transient are finished when this function returns.
    """
    blocks = list(block_periods([replace(e, periods=calls, transient_periods=1) for e in experiments]))
    for periods in blocks:
        next(periods)

    def step() -> None:
        for periods in blocks:
            next(periods)

    return step
