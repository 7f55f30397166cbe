"""A conformance checker for Gymnasium vector environments: spaces, seeding, fresh arrays, autoreset, equality."""

from collections.abc import Callable
from copy import deepcopy
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, iterate


def check_vector_env(
    make_vector: Callable[[int], VectorEnv],
    make_single: Callable[[], gym.Env] | None = None,
    num_envs: int = 3,
    steps: int = 25,
    seed: int = 0,
) -> None:
    """Check that a vector environment keeps Gymnasium's contract.

    The vector environment must be deterministic for a given seed, and its environment i must have the seed seed + i.

    Args:
        make_vector: makes the vector environment from num_envs.
        make_single: makes the scalar environment whose results must be equal exactly; None: not checked.
        num_envs: of the vector environment.
        steps: number of random steps; at least one episode must end within them, so that autoreset is checked.
        seed: of environments and actions.

    Raises:
        AssertionError: It does not; the message says what is wrong.
    """
    env = make_vector(num_envs)
    try:
        _check_spaces(env, num_envs)
        _check_outputs(env, seed)
        actions = _actions(env, steps, seed)
        first = _rollout(env, actions, seed)
        _check_same(first, _rollout(env, actions, seed), "a second reset with the same seed and the same actions")
        other = make_vector(num_envs)
        _check_same(first, _rollout(other, actions, seed), "another instance with the same seed and actions")
        other.close()
        different = _rollout(env, actions[:1], seed + 1000)
        assert not np.array_equal(first[0][0], different[0][0]), "another seed gives the same first observations"
        _check_fresh(first)
        _check_autoreset(env, first)
        if make_single is not None:
            _check_equals_single(env, make_single, first, actions, seed)
    finally:
        env.close()


_Step = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]


def _check_spaces(env: VectorEnv, n: int) -> None:
    assert env.num_envs == n, f"num_envs is {env.num_envs}, not {n}"
    for kind in ("action", "observation"):
        single, batched = getattr(env, f"single_{kind}_space"), getattr(env, f"{kind}_space")
        assert batched == batch_space(single, n), f"{kind}_space is not the batch of single_{kind}_space"
    mode = env.metadata.get("autoreset_mode")
    assert isinstance(mode, AutoresetMode), f"metadata['autoreset_mode'] = {mode!r} is not an AutoresetMode"


def _check_outputs(env: VectorEnv, seed: int) -> None:
    result = env.reset(seed=seed)
    assert isinstance(result, tuple) and len(result) == 2, "reset must return (observations, infos)"
    observation, info = result
    assert observation in env.observation_space, "the observations of reset are not in observation_space"
    assert isinstance(info, dict), "the infos of reset are not a dict"
    action = env.action_space.sample()
    kept = deepcopy(action)
    result = env.step(action)
    assert isinstance(result, tuple) and len(result) == 5, "step must return five values"
    observation, reward, terminated, truncated, info = result
    assert observation in env.observation_space, "the observations of step are not in observation_space"
    for name, values in (("rewards", reward), ("terminations", terminated), ("truncations", truncated)):
        assert isinstance(values, np.ndarray) and values.shape == (env.num_envs,), f"{name} are not one per environment"
    assert np.issubdtype(reward.dtype, np.floating), f"rewards are {reward.dtype}, not floating"
    assert terminated.dtype == truncated.dtype == np.bool_, "terminations and truncations are not bool"
    assert isinstance(info, dict), "the infos of step are not a dict"
    for name in info:
        if not name.startswith("_") and f"_{name}" in info:
            assert info[f"_{name}"].shape == (env.num_envs,), f"infos: the mask _{name} is not one per environment"
    assert _equal(action, kept), "step changes the actions it is given"


def _actions(env: VectorEnv, steps: int, seed: int) -> list[Any]:
    env.action_space.seed(seed)
    return [env.action_space.sample() for _ in range(steps)]


def _rollout(env: VectorEnv, actions: list[Any], seed: int) -> list[tuple]:
    """(observations, infos) of reset, then the results of every step, not copied, so that reused arrays are found."""
    results: list[tuple] = [env.reset(seed=seed)]
    for action in actions:
        results.append(env.step(action))
        if env.metadata["autoreset_mode"] is AutoresetMode.DISABLED and (results[-1][2] | results[-1][3]).any():
            mask = results[-1][2] | results[-1][3]
            env.reset(options={"reset_mask": mask})
    return results


def _check_same(a: list[tuple], b: list[tuple], what: str) -> None:
    for t, (one, two) in enumerate(zip(a, b, strict=True)):
        assert _equal(one, two), f"{what} does not repeat the results of step {t}"


def _check_fresh(results: list[tuple]) -> None:
    observations = [r[0] for r in results]
    for t, (a, b) in enumerate(pairwise(observations)):
        assert a is not b and not np.shares_memory(a, b), f"the observations of steps {t} and {t + 1} share memory"


def _check_autoreset(env: VectorEnv, results: list[tuple]) -> None:
    ends = [t for t, r in enumerate(results[1:-1], 1) if (r[2] | r[3]).any()]
    assert ends, "no episode ended: give more steps"
    mode = env.metadata["autoreset_mode"]
    for t in ends:
        ended = results[t][2] | results[t][3]
        if mode is AutoresetMode.NEXT_STEP:
            after = results[t + 1]
            assert (after[1][ended] == 0).all(), f"step {t + 1}: an environment that restarts has a reward"
            assert not (after[2] | after[3])[ended].any(), f"step {t + 1}: an environment that restarts ends at once"
        elif mode is AutoresetMode.SAME_STEP:
            info = results[t][4]
            assert {"final_obs", "_final_obs"} <= info.keys(), f"step {t}: an episode ended without final_obs in infos"
            assert (info["_final_obs"] == ended).all(), f"step {t}: _final_obs does not say which episodes ended"
            for i in np.flatnonzero(ended):
                inside = info["final_obs"][i] in env.single_observation_space
                assert inside, f"step {t}: final_obs of environment {i} is not in single_observation_space"


def _check_equals_single(
    env: VectorEnv, make_single: Callable[[], gym.Env], results: list[tuple], actions: list[Any], seed: int
) -> None:
    mode = env.metadata["autoreset_mode"]
    for i in range(env.num_envs):
        single = make_single()
        observation, info = single.reset(seed=seed + i)
        _compare(results[0][0][i], observation, 0, i, "observation")
        _compare_info(results[0][1], info, 0, i)
        over = False
        for t, action in enumerate(actions, 1):
            batch = results[t]
            if over and mode is AutoresetMode.NEXT_STEP:
                observation, info = single.reset()
                over = False
                _compare(batch[0][i], observation, t, i, "observation")
                _compare_info(batch[4], info, t, i)
                continue
            own = list(iterate(env.action_space, action))[i]
            observation, reward, terminated, truncated, info = single.step(own)
            over = terminated or truncated
            told = batch[4]
            if over and mode is AutoresetMode.SAME_STEP:
                _compare(told["final_obs"][i], observation, t, i, "final observation")
                _compare_info(told["final_info"], info, t, i)
                observation, info = single.reset()
            _compare(batch[0][i], observation, t, i, "observation")
            _compare_info(told, info, t, i)
            _compare(batch[1][i], reward, t, i, "reward")
            _compare(batch[2][i], terminated, t, i, "termination")
            _compare(batch[3][i], truncated, t, i, "truncation")
            if over and mode is AutoresetMode.DISABLED:
                single.reset()
        single.close()


def _compare(batch: Any, single: Any, t: int, i: int, what: str) -> None:
    assert np.array_equal(batch, single), f"step {t}, environment {i}: the {what} is not that of the scalar environment"


def _compare_info(batch: dict[str, Any], single: dict[str, Any], t: int, i: int) -> None:
    for name, value in single.items():
        assert name in batch and batch[f"_{name}"][i], f"step {t}, environment {i}: infos lack {name}"
        assert _equal(np.asarray(batch[name][i]), np.asarray(value)), (
            f"step {t}, environment {i}: info {name} is not that of the scalar environment"
        )


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(_equal(a[k], b[k]) for k in a)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(_equal, a, b))
    if isinstance(a, np.ndarray) and a.dtype == object:
        return a.shape == np.shape(b) and all(map(_equal, a.ravel(), np.ravel(b)))
    if a is None or b is None:
        return a is b
    x, y = np.asarray(a), np.asarray(b)
    return np.array_equal(x, y, equal_nan=np.issubdtype(x.dtype, np.inexact) and np.issubdtype(y.dtype, np.inexact))
