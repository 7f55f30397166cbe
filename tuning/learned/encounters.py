"""What a policy meets: experiments on drawn rigs at the gains that it chooses, and what they have in common."""

from collections.abc import Callable, Sequence

import numpy as np
import torch

from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from tuning.learned.familiar import Familiar, familiar
from tuning.learned.policy import HistoryPolicy, shape_for
from tuning.study.study import experiments

RIGS = 1000  # on which what is familiar to a policy is found
# Rigs that share a task, and with it an effect: few, because one strong effect on many rigs would make all that is as
# strange familiar. With 25 the limit was 6.8 on 700 rigs and 11.7 on 1000.
GROUP = 4
MIXED = 141421  # mixed into the seed so that these rigs never coincide with rigs drawn elsewhere

DrawTasks = Callable[[np.random.Generator], tuple[Task, Task]]


def encounters(
    task: Task,
    episodes: Sequence[Episode],
    policy: HistoryPolicy | None,
    count: int,
    rng: np.random.Generator,
    spread: float = 0.0,
    threads: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Experiments on n rigs: first at their safe starts, then at the gains that the policy chooses (None: at random).

    Args:
        task: The task of all rigs.
        episodes: The n rigs.
        policy: The policy.
        count: Number of experiments of each rig.
        rng: Source of the noise on the policy's actions, and of random gains.
        spread: Standard deviation of that noise, which half of the actions have.
        threads: Number of threads; None for all cores.

    Returns:
        Observations (n, count, size), float32, and scores (n, count).
    """
    n, k = len(episodes), len(task.box.names)
    seen = np.zeros((n, count, len(task.layout.names)), np.float32)
    scores = np.zeros((n, count))
    for t in range(count):
        if t == 0:
            points = np.stack([e.start for e in episodes])
        elif policy is None:
            points = rng.uniform(-1, 1, (n, k))
        else:
            points = policy.act(seen[:, :t]) + spread * rng.standard_normal((n, k)) * (rng.random((n, 1)) < 0.5)
        found = experiments(task, episodes, np.clip(points, -1, 1), [t + 1] * n, threads)
        seen[:, t], scores[:, t] = found.observation, found.score
    return seen, scores


def acquainted(
    draw_tasks: DrawTasks,
    policy: HistoryPolicy,
    rigs: int,
    seed: int,
    progress: Callable[[int], None] = lambda rigs: None,
) -> Familiar:
    """What is familiar to a policy, however it was trained: what it meets on freshly drawn rigs at gains of its own.

    Its actions have no noise, which they have while data are collected, as those of a tuner have none. The same seed
    gives the same numbers on the same machine.

    Args:
        draw_tasks: Draws a pair of tasks, of which the first is observed.
        policy: The policy, which stays as it is.
        rigs: Number of rigs.
        seed: Seed of every choice.
        progress: Called with the number of rigs since the last call.

    Raises:
        ValueError: The policy does not fit the tasks (`check_fits`).
    """
    seen, threads = [], torch.get_num_threads()
    torch.set_num_threads(1)  # so that sums are computed in the same order on any machine
    try:
        for group, begun in enumerate(range(0, rigs, GROUP)):
            rng = np.random.default_rng((MIXED, seed, group))
            task, _ = draw_tasks(rng)
            check_fits(policy, task)
            episodes = [task.draw(rng) for _ in range(min(GROUP, rigs - begun))]
            seen.append(encounters(task, episodes, policy, policy.shape.history, rng)[0])
            progress(len(episodes))
    finally:
        torch.set_num_threads(threads)
    return familiar(np.concatenate(seen))


def check_fits(policy: HistoryPolicy, task: Task) -> None:
    """Check that a policy was trained for a task.

    Raises:
        ValueError: It was not.
    """
    if policy.shape != shape_for(task, task.budget, policy.shape.width):
        raise ValueError("init: trained for other observations or gains, or another number of experiments, than here")
