"""Training of a policy by imitation (DAgger: Ross, Gordon and Bagnell 2011).

Rigs are drawn, the best gains of each are searched on its simulator, and the policy learns to predict them from the
results of its own experiments.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from maglev_env.recordings.result_folder import load_arrays, save_arrays
from tuning.learned.encounters import RIGS, DrawTasks, acquainted, encounters
from tuning.learned.policy import HistoryPolicy, Shape, shape_for, stack
from tuning.lockstep import optima

if TYPE_CHECKING:
    from maglev_lanes.schedule import Workers

SPREAD = 0.15  # standard deviation of the noise on a policy's actions while it collects data, for variety
GROUP = 125  # rigs of one task whose experiments are simulated together


@dataclass(frozen=True)
class Plan:
    """Size of a training.

    Attributes:
        rigs: Number of rigs in all.
        rounds: Rounds in which they are used, each with the policy that the earlier rounds gave.
        search: Experiments that search for the best gains of each rig.
        epochs: Epochs over all data after each round.
        batch: Batch size.
        rate: Learning rate.
        history: Number of stacked observations.
        width: Width of the hidden layers.
    """

    rigs: int = 6000
    rounds: int = 6
    search: int = 300
    epochs: int = 60
    batch: int = 512
    rate: float = 1e-3
    history: int = 10
    width: int = 192

    def __post_init__(self) -> None:
        if min(self.rigs, self.rounds, self.search, self.epochs, self.batch, self.width) < 1 or self.history < 2:
            raise ValueError("training: rigs, rounds, search, epochs, batch and width are 1 or more, history 2 or more")
        if self.rigs < self.rounds:
            raise ValueError(f"training: rigs = {self.rigs}; give at least one for each of the {self.rounds} rounds")


@dataclass(frozen=True, eq=False)
class Group:
    """n rigs: best gains (n, k); observations (n, history, size) and scores (n, history) of their experiments."""

    best: np.ndarray
    seen: np.ndarray
    scores: np.ndarray


@dataclass(frozen=True, eq=False)
class _Job:
    """A group of rigs to collect data from: its size, the policy so far, and the seed of every choice."""

    draw_tasks: DrawTasks
    plan: Plan
    n: int
    policy: HistoryPolicy | None
    seed: tuple[int, int, int]


def train(
    draw_tasks: DrawTasks,
    plan: Plan,
    seed: int,
    folder: Path | None = None,
    progress: Callable[[str, int], None] = lambda text, rigs: None,
    workers: "Workers | None" = None,
) -> tuple[HistoryPolicy, list[dict[str, float]]]:
    """Train a policy by imitation.

    A finished group of rigs is stored in the folder and not repeated, so that an interrupted training can be resumed.
    The same seed gives the same policy on the same machine, with and without workers.

    Args:
        draw_tasks: Draws a pair of tasks, all with the same observations and gains: the policy observes the first, and
            the best gains of its rigs are searched on the second.
        plan: Size of the training.
        seed: Seed of every choice.
        folder: Where finished groups are stored.
        progress: Called with the name of the round and the number of rigs since the last call.
        workers: Where the groups are made.

    Returns:
        The policy; and for each round its mean score after one and after all experiments of a rig, and its loss.

    Raises:
        ValueError: The tasks have another number of experiments than the plan's history.
    """
    task, _ = draw_tasks(np.random.default_rng(seed))
    if task.budget != plan.history:
        raise ValueError(f"training: history = {plan.history}; the tasks have {task.budget} experiments, give as many")
    shape = shape_for(task, plan.history, plan.width)
    groups: list[Group] = []
    log, policy = [], None
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # so that sums are computed in the same order on any machine
    try:
        for turn in range(plan.rounds):
            said = f"round {turn + 1} of {plan.rounds}"
            jobs = [_Job(draw_tasks, plan, n, policy, (seed, turn, i)) for i, n in enumerate(_sizes(plan, turn))]
            new = _gathered(jobs, folder, lambda n, said=said: progress(said, n), workers)
            groups += new
            policy, loss = _fit(shape, groups, plan, seed)
            scores = np.concatenate([g.scores for g in new])
            log.append({"second": float(scores[:, 1].mean()), "best": float(scores.max(axis=1).mean()), "loss": loss})
        policy.familiar = acquainted(draw_tasks, policy, min(plan.rigs, RIGS), seed)
    finally:
        torch.set_num_threads(threads)
    return policy, log


def _sizes(plan: Plan, turn: int) -> list[int]:
    count = plan.rigs // plan.rounds + (turn < plan.rigs % plan.rounds)
    return [min(GROUP, count - begun) for begun in range(0, count, GROUP)]


def _gathered(
    jobs: Sequence[_Job], folder: Path | None, progress: Callable[[int], None], workers: "Workers | None"
) -> list[Group]:
    """The groups of all jobs, in order: stored ones are read, others are made."""
    paths = [None if folder is None else folder / f"round-{j.seed[1] + 1}-{j.seed[2] + 1:03d}.npz" for j in jobs]
    groups = [_kept(path) for path in paths]
    todo = [i for i, group in enumerate(groups) if group is None]
    if kept := sum(j.n for j, group in zip(jobs, groups, strict=True) if group is not None):
        progress(kept)
    missing = [jobs[i] for i in todo]
    for at, group in enumerate(map(_group, missing)) if workers is None else workers.each(_on_worker, missing):
        i = todo[at]
        groups[i] = group
        if paths[i] is not None:
            save_arrays(paths[i], vars(group))
        progress(jobs[i].n)
    return groups


def _on_worker(job: _Job) -> Group:
    torch.set_num_threads(1)
    return _group(job, threads=1)


def _kept(path: Path | None) -> Group | None:
    if path is None or not path.exists():
        return None
    arrays = load_arrays(path)
    if arrays.keys() != {f.name for f in fields(Group)}:
        raise ValueError(f"{path} is damaged (it holds {', '.join(arrays)}); delete it, and it is made again")
    return Group(**arrays)


def _group(job: _Job, threads: int | None = None) -> Group:
    """Rigs of one task, and experiments on them with the noisy policy, or at random while there is none."""
    plan, n, policy, rng = job.plan, job.n, job.policy, np.random.default_rng(job.seed)
    task, searched = job.draw_tasks(rng)
    episodes = [task.draw(rng) for _ in range(n)]
    same = [replace(e, rig=replace(e.rig, protocol=searched.rig.protocol)) for e in episodes]
    best, _ = optima(searched, same, int(rng.integers(2**31)), plan.search, threads)
    seen, scores = encounters(task, episodes, policy, plan.history, rng, SPREAD, threads)
    return Group(best, seen, scores)


def _fit(shape: Shape, groups: Sequence[Group], plan: Plan, seed: int) -> tuple[HistoryPolicy, float]:
    """A new policy fitted to all data, and its loss in the last epoch."""
    inputs = [stack(g.seen[:, :t], plan.history) for g in groups for t in range(1, plan.history)]
    targets = [g.best.astype(np.float32) for g in groups for _ in range(1, plan.history)]
    x, y = torch.from_numpy(np.concatenate(inputs)), torch.from_numpy(np.concatenate(targets))
    torch.manual_seed(seed)
    policy, rng, loss = HistoryPolicy(shape), np.random.default_rng(seed), 0.0
    optimiser = torch.optim.Adam(policy.parameters(), plan.rate)
    batches = -(-len(x) // plan.batch)
    rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, 2 * plan.rate, total_steps=plan.epochs * batches)
    for _ in range(plan.epochs):
        order, losses = rng.permutation(len(x)), []
        for at in range(0, len(x), plan.batch):
            chosen = torch.from_numpy(order[at : at + plan.batch])
            optimiser.zero_grad()
            off = torch.nn.functional.smooth_l1_loss(policy(x[chosen]), y[chosen])
            off.backward()
            optimiser.step()
            rate.step()
            losses.append(float(off.detach()))
        loss = float(np.mean(losses))
    return policy.eval(), loss
