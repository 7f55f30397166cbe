"""Train a policy by imitation: rigs are drawn, the best gains of each are searched for on its simulator, and the policy
learns to name them from what its own experiments show (DAgger: Ross, Gordon and Bagnell 2011)."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from maglev_env.envs.task import Tuning
from tuning.learned.policy import HistoryPolicy, Shape, stack
from tuning.search.lockstep import optima
from tuning.search.study import experiments

SPREAD = 0.15  # of the noise on a policy's actions while it gathers: what it may meet later
GROUP = 256  # rigs whose experiments run together


@dataclass(frozen=True)
class Plan:
    """rigs drawn in all; rounds in which they are used, each with the policy that the ones before have made; search:
    experiments for the best gains of each; epochs over everything gathered, per round; batch, learning rate."""

    rigs: int = 6000
    rounds: int = 6
    search: int = 300
    epochs: int = 30
    batch: int = 512
    rate: float = 1e-3
    history: int = 10
    width: int = 192


def train(
    tasks: Sequence[Tuning], plan: Plan, seed: int, progress: Callable[[str], None] = lambda text: None
) -> tuple[HistoryPolicy, list[dict[str, float]]]:
    """A policy for rigs of all the tasks alike (they share observations and gains), and per round its mean score after
    one and after all experiments of a rig, and its loss. The same seed gives the same policy on the same machine."""
    names, gains = tasks[0].layout.names, tasks[0].box.names
    if any((t.layout.names, t.box.names) != (names, gains) for t in tasks):
        raise ValueError("training: tasks must share their observations and gains")
    torch.manual_seed(seed)
    policy = HistoryPolicy(Shape(tuple(names), tuple(gains), plan.history, plan.width))
    optimiser = torch.optim.Adam(policy.parameters(), plan.rate)
    rng = np.random.default_rng(seed)
    inputs, targets, log = [], [], []
    per_round = -(-plan.rigs // plan.rounds)
    for turn in range(plan.rounds):
        first, last, met = [], [], 0
        for task, count in zip(tasks, _shares(per_round, len(tasks)), strict=True):
            for n in _groups(count):
                episodes = [task.draw(rng) for _ in range(n)]
                best, _ = optima(task, episodes, int(rng.integers(2**31)), plan.search)
                seen, scores = _gathered(task, episodes, policy, turn > 0, plan.history, rng)
                for t in range(1, plan.history):
                    inputs.append(stack(seen[:, :t], plan.history))
                    targets.append(best.astype(np.float32))
                first.append(scores[:, 1])
                last.append(scores.max(axis=1))
                met += n
                progress(f"round {turn + 1} of {plan.rounds}: {met} of {per_round} rigs")
        loss = _fit(policy, optimiser, np.concatenate(inputs), np.concatenate(targets), plan, rng)
        log.append(
            {"second": float(np.concatenate(first).mean()), "best": float(np.concatenate(last).mean()), "loss": loss}
        )
    return policy.eval(), log


def _shares(total: int, parts: int) -> list[int]:
    return [total // parts + (i < total % parts) for i in range(parts)]


def _groups(count: int) -> Iterator[int]:
    for begun in range(0, count, GROUP):
        yield min(GROUP, count - begun)


def _gathered(
    task: Tuning, episodes: Sequence, policy: HistoryPolicy, trained: bool, steps: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Observations (n, steps, size) and scores (n, steps) under the policy with noise, or at random while untrained."""
    n, k = len(episodes), len(policy.shape.gains)
    seen = np.zeros((n, steps, len(policy.shape.names)), np.float32)
    scores = np.zeros((n, steps))
    for t in range(steps):
        if t == 0:
            points = np.stack([e.start for e in episodes])
        elif trained:
            points = policy.act(seen[:, :t]) + SPREAD * rng.standard_normal((n, k)) * (rng.random((n, 1)) < 0.5)
        else:
            points = rng.uniform(-1, 1, (n, k))
        found = experiments(task, episodes, np.clip(points, -1, 1), [t + 1] * n)
        seen[:, t], scores[:, t] = found.observation, found.score
    return seen, scores


def _fit(policy, optimiser, inputs: np.ndarray, targets: np.ndarray, plan: Plan, rng: np.random.Generator) -> float:
    """Mean squared error of the last epoch."""
    x, y = torch.from_numpy(inputs), torch.from_numpy(targets)
    policy.train()
    loss = 0.0
    for _ in range(plan.epochs):
        order, losses = rng.permutation(len(x)), []
        for at in range(0, len(x), plan.batch):
            chosen = torch.from_numpy(order[at : at + plan.batch])
            optimiser.zero_grad()
            off = nn_loss(policy(x[chosen]), y[chosen])
            off.backward()
            optimiser.step()
            losses.append(float(off.detach()))
        loss = float(np.mean(losses))
    return loss


nn_loss = torch.nn.functional.smooth_l1_loss
