"""Draws of a condition, on one process or several."""

from collections.abc import Callable
from contextlib import nullcontext
from functools import partial

from maglev_lanes.processes import fresh_pool
from maglev_workbench.commands.coverage.conditions import Condition
from maglev_workbench.commands.coverage.counts import Coverage


def coverage(
    condition: Condition,
    draws: int,
    seed: int,
    progress: Callable[[], object] = lambda: None,
    processes: int = 1,
) -> tuple[Coverage, ...]:
    """Draw experiments, identify each as a user would, and count.

    Args:
        condition: what is drawn.
        draws: at least 2.
        seed: of the study.
        progress: called after each draw.
        processes: that share the draws; they do not change the result.
    """
    drawn, found = partial(condition.drawn, seed), []
    with fresh_pool(processes) if processes > 1 else nullcontext() as pool:
        for one in (map if pool is None else pool.map)(drawn, range(draws)):
            found.append(one)
            progress()
    return condition.counted(found)
