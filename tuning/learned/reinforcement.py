"""Training of a policy by reinforcement, with PPO (Schulman et al. 2017) or SAC (Haarnoja et al. 2018) of
Stable-Baselines3, on episodes that run like a learned tuner's studies."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from torch import nn

from maglev_env.task.task import Tuning
from tuning.learned.policy import HistoryPolicy, Shape, shape_for
from tuning.learned.study_env import study_env

ALGORITHMS = ("ppo", "sac")
EPISODES = 4  # episodes of every environment between two updates of PPO
ENTROPY = "auto_0.01"  # SAC's first weight of the entropy; rewards are of order 1
KEPT = 200_000  # largest number of experiments in SAC's replay buffer
RANDOM = 0.1  # share of SAC's experiments that are random at the start, to give its critic something to compare
WARM_UP = 0.2  # share of the experiments in which only the critic learns, if a policy is given
SPREAD = (0.15, 0.5)  # standard deviation of the first actions, around those of a given policy and of a new one
NUM_ENVS = 64
ROWS = 50  # rows of the log


def train_by_reinforcement(
    tasks: Sequence[Tuning],
    algorithm: str,
    experiments: int,
    seed: int,
    init: HistoryPolicy | None = None,
    width: int = 192,
    num_envs: int = NUM_ENVS,
    rate: float = 3e-4,
    progress: Callable[[int], None] = lambda done: None,
) -> tuple[HistoryPolicy, list[dict[str, float]]]:
    """Train a policy for rigs of all tasks, which share observations, gains and budget.

    An episode is a study of one rig: its safe start, then budget - 1 experiments that the policy chooses. Its return is
    the undiscounted sum of their rewards (`maglev_env.task.task.rewards`). The same seed gives the same policy on the
    same machine.

    Args:
        tasks: The tasks.
        algorithm: "ppo" or "sac".
        experiments: Number of chosen experiments in all, rounded down to whole rounds of the environments (for PPO to
            whole rollouts of several episodes of each). The safe starts are not counted.
        seed: Seed of the training.
        init: Policy to continue from, with its width; the critic learns before it changes.
        width: Width of a new policy; its history is the budget.
        num_envs: Number of environments.
        rate: Learning rate.
        progress: Called with the number of experiments made so far.

    Returns:
        The policy; and a log with the number of `experiments` so far and the mean `return` of the episodes that ended
        since the row before.

    Raises:
        ValueError: An argument is wrong; the message names it.
    """
    check_training(tasks, algorithm, experiments, init, num_envs)
    shape = shape_for(tasks[0], tasks[0].budget, width if init is None else init.shape.width)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # small networks: more threads cost more than they gain, and change the rounding
    try:
        model = make_learner(tasks, shape, algorithm, experiments, seed, num_envs, rate, init)
        watch = _Watch(experiments, experiments * WARM_UP if init is not None else 0, progress)
        a_round = num_envs * (model.n_steps if isinstance(model, PPO) else 1)
        model.learn(experiments // a_round * a_round, watch)
        return exported(model, shape), watch.rows
    finally:
        torch.set_num_threads(threads)


def check_training(
    tasks: Sequence[Tuning], algorithm: str, experiments: int, init: HistoryPolicy | None, num_envs: int = NUM_ENVS
) -> None:
    """Check the arguments of `train_by_reinforcement`.

    Raises:
        ValueError: One of them is wrong; the message names it.
    """
    if not tasks:
        raise ValueError("tasks: give at least one")
    if init is not None and init.shape != shape_for(tasks[0], tasks[0].budget, init.shape.width):
        raise ValueError("init: trained for other observations or gains, or another number of experiments, than here")
    if algorithm not in ALGORITHMS:
        raise ValueError(f"algorithm = {algorithm!r}; use one of {', '.join(ALGORITHMS)}")
    if num_envs < 2:
        raise ValueError(f"num_envs = {num_envs}; give at least 2 environments")
    if experiments < (least := num_envs * (tasks[0].budget - 1)):
        raise ValueError(
            f"experiments = {experiments}; give at least {least}, an episode of each of the {num_envs} environments"
        )


def make_learner(
    tasks: Sequence[Tuning],
    shape: Shape,
    algorithm: str,
    experiments: int,
    seed: int,
    num_envs: int,
    rate: float,
    init: HistoryPolicy | None = None,
) -> PPO | SAC:
    """The learner before training; its actor is init where given. Arguments as in `train_by_reinforcement`."""
    steps = tasks[0].budget - 1
    env = study_env(tasks, shape, num_envs)
    # A derived seed, because environment i would otherwise draw the same rigs as a test with the seed `seed + i`.
    derived = int(np.random.SeedSequence(seed).generate_state(1)[0])
    # A study ends with its budget and nothing counts after it: no discount, and no value beyond the end.
    shared: dict[str, Any] = {"learning_rate": rate, "gamma": 1.0, "seed": derived, "device": "cpu"}
    layers, spread = [shape.width, shape.width], float(np.log(SPREAD[init is None]))
    model: PPO | SAC
    if algorithm == "ppo":
        episodes = min(EPISODES, experiments // (num_envs * steps))
        nets = {"net_arch": {"pi": layers, "vf": layers}, "activation_fn": nn.ReLU, "log_std_init": spread}
        sizes = {"n_steps": episodes * steps, "batch_size": episodes * num_envs}  # whole episodes, whole batches
        model = PPO("MlpPolicy", env, **sizes, policy_kwargs=nets, **shared)
        # The mean is limited to the box like a HistoryPolicy's action; the optimiser already holds the layer's weights.
        model.policy.action_net = nn.Sequential(model.policy.action_net, nn.Tanh())
    else:
        model = SAC(
            "MlpPolicy",
            env,
            buffer_size=max(min(experiments, KEPT), 2 * num_envs),
            optimize_memory_usage=True,  # one observation per experiment instead of two
            replay_buffer_kwargs={"handle_timeout_termination": False},
            learning_starts=int(experiments * RANDOM),
            gradient_steps=max(num_envs // 4, 1),
            ent_coef=ENTROPY,
            policy_kwargs={"net_arch": {"pi": layers, "qf": layers}},
            **shared,
        )
        nn.init.zeros_(model.actor.log_std.weight)
        nn.init.constant_(model.actor.log_std.bias, spread)
    model.set_logger(Logger(None, []))
    if init is not None:
        for layer, given in zip(_layers(model), _linear(init), strict=True):
            layer.load_state_dict(given.state_dict())
    return model


def exported(model: PPO | SAC, shape: Shape) -> HistoryPolicy:
    """The learner's deterministic policy."""
    policy = HistoryPolicy(shape)
    for given, layer in zip(_linear(policy), _layers(model), strict=True):
        given.load_state_dict(layer.state_dict())
    return policy.eval()


def _linear(policy: HistoryPolicy) -> list[nn.Linear]:
    return [part for part in policy.net if isinstance(part, nn.Linear)]


def _layers(model: PPO | SAC) -> list[nn.Linear]:
    """Linear layers of the actor's mean, in the order of a HistoryPolicy."""
    if isinstance(model, PPO):
        parts = [*model.policy.mlp_extractor.policy_net, *model.policy.action_net]
    else:
        parts = [*model.actor.latent_pi, model.actor.mu]
    return [part for part in parts if isinstance(part, nn.Linear)]


class _Watch(BaseCallback):
    """Reports progress, writes the log, and keeps the actor fixed during the first `still` experiments."""

    def __init__(self, experiments: int, still: float, progress: Callable[[int], None]) -> None:
        super().__init__()
        self.rows: list[dict[str, float]] = []
        self._every, self._still, self._progress = experiments / ROWS, still, progress
        self._returns: list[float] = []

    def _on_training_start(self) -> None:
        self._hold(self._still > 0)

    def _on_step(self) -> bool:
        if self.num_timesteps >= self._still:
            self._hold(False)
        self._returns += [float(info["episode"]["r"]) for info in self.locals["infos"] if "episode" in info]
        if self.num_timesteps - (self.rows[-1]["experiments"] if self.rows else 0) >= self._every:
            self._row()
        self._progress(self.num_timesteps)
        return True

    def _on_training_end(self) -> None:
        self._row()

    def _hold(self, still: bool) -> None:
        spread = [self.model.policy.log_std] if isinstance(self.model, PPO) else self.model.actor.log_std.parameters()
        for parameter in (*spread, *(p for layer in _layers(self.model) for p in layer.parameters())):
            parameter.requires_grad_(not still)

    def _row(self) -> None:
        if self._returns:
            self.rows.append({"experiments": self.num_timesteps, "return": float(np.mean(self._returns))})
            self._returns = []
