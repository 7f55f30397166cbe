"""Reinforcement: episodes as studies run, actors that are policies to the bit, and learning on a cheap task."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from maglev_env.task.task import make_task
from tuning.learned import reinforcement
from tuning.learned.policy import HistoryPolicy, shape_for, stack
from tuning.learned.reinforcement import exported, make_learner, train_by_reinforcement
from tuning.learned.study_env import study_env
from tuning.learned.tuner import LearnedTuner
from tuning.lockstep import side_by_side

BUDGET = 4


@dataclass(frozen=True, eq=False)
class Hidden:
    """An optimum (2,), and the sign by which what is seen of it is turned."""

    optimum: np.ndarray
    start: np.ndarray


class Bowl:
    """The best point differs from rig to rig; a half of it is seen, and more of it than one experiment shows is noise.
    Far from it the rotor touches down."""

    name, terminate_on_touchdown = "bowl", True

    def __init__(self, side: float = 1.0) -> None:
        self.box = SimpleNamespace(names=("a", "b"), low=-np.ones(2), high=np.ones(2), gains=lambda points: points)
        self.layout = SimpleNamespace(names=("seen_a", "seen_b", "tried_a", "tried_b", "left"))
        self.side, self.budget = side, BUDGET
        self.drawn: list[Hidden] = []
        self.made: list[tuple[Hidden, np.ndarray, int, np.ndarray]] = []

    def tried(self, last, actions):
        return np.clip(last + 0.3 * actions, -1, 1)  # not what a study does

    def draw(self, rng):
        self.drawn.append(Hidden(rng.uniform(0.1, 0.8, 2) * self.side * rng.choice([-1, 1], 2), rng.uniform(-1, 1, 2)))
        return self.drawn[-1]

    def measure(self, episodes, actions, counts, threads):
        best = np.stack([e.optimum for e in episodes])
        off = np.linalg.norm(actions - best, axis=1)
        noise = np.stack([np.random.default_rng([c, *(e.optimum * 1e6).astype(int) % 997]).normal(0, 0.1, 2)
                          for e, c in zip(episodes, counts, strict=True)])  # fmt: skip
        left = 1 - np.asarray(counts)[:, None] / BUDGET
        seen = np.clip(np.concatenate([-best / 2 + noise, actions, left], axis=1), -1, 1).astype(np.float32)
        self.made += list(zip(episodes, actions.copy(), counts, seen, strict=True))
        found = SimpleNamespace(score=np.clip(1 - off, 0, 1), touchdown_time=np.where(off > 1.6, 0.1, np.nan), terms={})
        return found, seen

    def told(self, found):
        return {}


SHAPE = shape_for(Bowl(), BUDGET, 16)


@pytest.fixture(autouse=True)
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


class Recorded:
    """A task that keeps its episodes."""

    def __init__(self, task):
        self.task, self.drawn = task, []

    def __getattr__(self, name):
        return getattr(self.task, name)

    def draw(self, rng):
        self.drawn.append(self.task.draw(rng))
        return self.drawn[-1]


def test_an_episode_is_the_study_of_a_learned_tuner():
    task, n = make_task(protocol="quick", randomization="wide", draw_target=True, budget=BUDGET, move=0.3), 3
    shape = shape_for(task, BUDGET, 16)
    torch.manual_seed(0)
    policy, recorded = HistoryPolicy(shape), Recorded(task)
    env = study_env([recorded], shape, n)
    env.seed(3)
    stacked, rewards = env.reset(), np.zeros(n)
    for _ in range(BUDGET - 1):
        with torch.no_grad():
            stacked, reward, done, told = env.step(policy(torch.from_numpy(stacked)).numpy())
        rewards += reward
    assert done.all()
    episodes = recorded.drawn[:n]
    tuners = [LearnedTuner(task, e, policy, 0) for e in episodes]
    for i, trials in enumerate(side_by_side(task, episodes, tuners, BUDGET)):
        np.testing.assert_allclose(
            told[i]["terminal_observation"], stack(trials.observation[None], BUDGET)[0], atol=1e-5
        )
        expected = np.where(trials.touchdown, -1.0, trials.score)[1:].sum()
        assert rewards[i] == pytest.approx(expected, abs=1e-4)
        assert told[i]["episode"]["r"] == pytest.approx(expected, abs=1e-4)


def test_every_step_shows_what_its_own_episode_has_seen():
    """At random actions, of which some make the rotor touch down: over two episodes, and into a third."""
    task, n, rng = Bowl(), 5, np.random.default_rng(0)
    env = study_env([task], SHAPE, n)
    env.seed(3)
    found, down = [env.reset()], 0
    for turn in range(2 * (BUDGET - 1)):
        actions = rng.uniform(-1, 1, (n, 2)).astype(np.float32)
        stacked, rewards, done, told = env.step(actions)
        assert done.all() == (turn % (BUDGET - 1) == BUDGET - 2) and done.any() == done.all()
        tried = task.made[-2 * n : -n] if done.all() else task.made[-n:]
        np.testing.assert_array_equal([m[1] for m in tried], actions)
        down += (rewards < 0).sum()
        if done.all():
            found.append(np.stack([one["terminal_observation"] for one in told]))
            assert not any(one["TimeLimit.truncated"] for one in told)
        found.append(stacked)
    assert 0 < down < 2 * n * (BUDGET - 1)
    seen = np.stack([m[3] for m in task.made]).reshape(-1, n, 5)  # by experiment
    assert [m[2] for m in task.made[::n]] == [1, 2, 3, 4, 1, 2, 3, 4, 1] and len(found) == len(seen)
    for i, one in enumerate(found):
        first = i - i % BUDGET
        np.testing.assert_array_equal(one, stack(seen[first : i + 1].swapaxes(0, 1), BUDGET))
    assert len({id(m[0]) for m in task.made}) == 3 * n
    np.testing.assert_array_equal([m[1] for m in task.made[:n]], [m[0].start for m in task.made[:n]])


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
@pytest.mark.parametrize("given", [False, True])
def test_a_learner_acts_as_the_policy_it_began_from_and_as_the_one_exported(algorithm, given):
    torch.manual_seed(5)
    init = HistoryPolicy(SHAPE)
    model = make_learner([Bowl()], SHAPE, algorithm, 100, 0, 4, 3e-4, init if given else None)
    seen = np.random.default_rng(1).uniform(-1, 1, (200, 3, 5)).astype(np.float32)
    if not given:
        model.learn(100)  # so that every bias is other than 0
    acted, _ = model.predict(stack(seen, BUDGET), deterministic=True)
    np.testing.assert_allclose(exported(model, SHAPE).act(seen), acted, atol=1e-6)
    if given:
        np.testing.assert_allclose(init.act(seen), acted, atol=1e-6)
    assert np.ptp(acted, axis=0).min() > 1e-3


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_training_repeats_and_reports(algorithm):
    arguments = {"width": 8, "num_envs": 4}
    before, told = torch.get_num_threads(), []
    (one, log), (same, _), (other, _) = (
        train_by_reinforcement([Bowl()], algorithm, 100, seed, progress=told.append, **arguments) for seed in (1, 1, 2)
    )
    weights = [torch.cat([p.flatten() for p in policy.parameters()]).detach() for policy in (one, same, other)]
    assert torch.equal(weights[0], weights[1]) and not torch.equal(weights[0], weights[2])
    assert torch.get_num_threads() == before
    total = 96 if algorithm == "ppo" else 100  # whole rollouts of 4 x 12
    assert told == [*range(4, total + 1, 4)] * 3
    assert [row["experiments"] for row in log] == [*range(12, total + 1, 12)]
    assert all(-3 <= row["return"] <= 3 for row in log)


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_an_interruption_passes(algorithm):
    def stop(done):
        raise KeyboardInterrupt

    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with pytest.raises(KeyboardInterrupt):
            train_by_reinforcement([Bowl()], algorithm, 100, 0, num_envs=4, progress=stop)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_rigs_of_several_tasks_and_of_no_test_by_seed():
    tasks = [Bowl(1.0), Bowl(0.01)]
    env = study_env(tasks, SHAPE, 20)
    env.seed(0)
    env.reset()
    assert all(task.drawn for task in tasks)
    for task in tasks:
        for hidden, _, _, seen in task.made:
            assert (abs(hidden.optimum).max() <= 0.01) == (task.side == 0.01)
            assert abs(seen[:2] + hidden.optimum / 2).max() < 0.5
    task = Bowl()
    make_learner([task], SHAPE, "ppo", 100, 0, 8, 3e-4).env.reset()
    held_out = [Bowl().draw(np.random.default_rng(seed)).optimum for seed in range(8)]
    assert not any(np.array_equal(a.optimum, b) for a in task.drawn for b in held_out)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"algorithm": "td3"}, "algorithm = 'td3'"),
        ({"experiments": 11}, "experiments = 11"),
        ({"num_envs": 1}, "num_envs = 1"),
        ({"init": HistoryPolicy(replace(SHAPE, history=BUDGET + 1, width=8))}, "init: "),
        ({"init": HistoryPolicy(replace(SHAPE, names=("x",), width=8))}, "init: "),
    ],
)
def test_bad_arguments_are_named(change, message):
    arguments = {"algorithm": "sac", "experiments": 100, "seed": 0, "num_envs": 4} | change
    with pytest.raises(ValueError, match=message):
        train_by_reinforcement([Bowl()], **arguments)


def test_tasks_that_do_not_belong_together_are_refused():
    other, short = Bowl(), Bowl()
    with pytest.raises(ValueError, match="at least one"):
        train_by_reinforcement([], "ppo", 100, 0)
    other.budget, short.budget = 5, 1
    with pytest.raises(ValueError, match="share"):
        train_by_reinforcement([Bowl(), other], "ppo", 100, 0, num_envs=4)
    with pytest.raises(ValueError, match="nothing is left"):
        train_by_reinforcement([short], "ppo", 100, 0, num_envs=4)


def deployed(policy: HistoryPolicy) -> np.ndarray:
    """Mean score of every experiment of a study, on rigs not trained on."""
    task, rng = Bowl(), np.random.default_rng(99)
    episodes = [task.draw(rng) for _ in range(300)]
    seen, scores = np.zeros((300, BUDGET, 5), np.float32), np.zeros(BUDGET)
    for t in range(BUDGET):
        points = policy.act(seen[:, :t]) if t else np.stack([e.start for e in episodes])
        found, seen[:, t] = task.measure(episodes, points, [t + 1] * 300, None)
        scores[t] = found.score.mean()
    return scores


def best_for_all() -> float:
    """Mean score of the best of all points that are the same for every rig."""
    rng, task = np.random.default_rng(7), Bowl()
    optima = np.stack([task.draw(rng).optimum for _ in range(2000)])
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 21)] * 2), axis=-1).reshape(-1, 1, 2)
    return np.clip(1 - np.linalg.norm(grid - optima, axis=-1), 0, 1).mean(axis=1).max()


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "experiments"), [("ppo", 4000), ("sac", 2000)])
def test_it_learns_what_each_rig_wants(algorithm, experiments):
    """The last point of a study is better than the first: what was seen before counts too."""
    policy, log = train_by_reinforcement([Bowl()], algorithm, experiments, 0, width=32, num_envs=16, rate=2e-3)
    scores = deployed(policy)
    assert scores[1:].min() > best_for_all() + 0.2
    assert scores[3] > scores[1] + 0.03
    assert log[-1]["return"] > log[0]["return"] + 0.5


def half_way() -> HistoryPolicy:
    """What imitation of half the best point teaches."""
    torch.manual_seed(0)
    policy, task, rng = HistoryPolicy(replace(SHAPE, width=32)), Bowl(), np.random.default_rng(5)
    rigs = [task.draw(rng) for _ in range(400)]
    seen = np.stack([task.measure(rigs, rng.uniform(-1, 1, (400, 2)), [t] * 400, None)[1] for t in (1, 2, 3)], axis=1)
    best = torch.tensor(np.stack([rig.optimum for rig in rigs]), dtype=torch.float32)
    inputs = [torch.from_numpy(stack(seen[:, :t], BUDGET)) for t in (1, 2, 3)]
    optimiser = torch.optim.Adam(policy.parameters(), 3e-3)
    for _ in range(60):
        optimiser.zero_grad()
        sum(((policy(one) - best / 2) ** 2).mean() for one in inputs).backward()
        optimiser.step()
    return policy.eval()


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "experiments"), [("ppo", 1500), ("sac", 1000)])
def test_it_makes_a_given_policy_better(algorithm, experiments):
    init = half_way()
    policy, _ = train_by_reinforcement([Bowl()], algorithm, experiments, 0, init, num_envs=16, rate=1e-3)
    assert (deployed(policy) - deployed(init))[1:].mean() > 0.07


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_given_policy_rests_while_what_judges_it_learns(algorithm, monkeypatch):
    torch.manual_seed(5)
    init = HistoryPolicy(SHAPE)
    seen = np.random.default_rng(1).uniform(-1, 1, (20, 3, 5))
    for share, same in ((2.0, True), (0.2, False)):
        monkeypatch.setattr(reinforcement, "WARM_UP", share)
        policy, _ = train_by_reinforcement([Bowl()], algorithm, 200, 0, init, num_envs=4)
        assert np.array_equal(policy.act(seen), init.act(seen)) is same
