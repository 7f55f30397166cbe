"""Every search by the same contract, on a score that is known in closed form."""

import numpy as np
import pytest

from tuning.search.evolution import DifferentialEvolution
from tuning.search.local import NelderMead, Quadratic
from tuning.search.optuna_search import OptunaTuner
from tuning.search.space_filling import Grid, Sobol
from tuning.search.started import AfterRule, Around
from tuning.tuner import Trials

SAMPLERS = ("tpe", "cma-es", "gp")
PEAK = np.array([0.35, -0.2, 0.6])
MAKERS = {
    "sobol": lambda seed: Sobol(3, seed),
    "grid": lambda seed: Grid(3, seed, 125),
    "de": lambda seed: DifferentialEvolution(3, seed, population=5),
    "nelder-mead": lambda seed: NelderMead(3, seed, np.zeros(3), 0.3),
    "quadratic": lambda seed: Quadratic(3, seed, np.zeros(3), 0.3),
    **{name: (lambda seed, name=name: OptunaTuner(3, seed, name)) for name in SAMPLERS},
}
LEARNING = ["de", "nelder-mead", "quadratic", *SAMPLERS]


def tried(points):
    """A score in (0, 1] that falls off from PEAK."""
    score = np.exp(-2 * ((points - PEAK) ** 2).sum(axis=1))
    return Trials(points, score, np.empty((len(points), 0)), ({},) * len(points), np.zeros(len(points), bool))


def run(tuner, budget, batch):
    found = None
    while found is None or len(found) < budget:
        points = tuner.ask(min(batch, budget - (0 if found is None else len(found))))
        trials = tried(points)
        tuner.tell(trials)
        found = trials if found is None else found + trials
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", MAKERS)
def test_points_lie_in_the_box_and_repeat_with_the_seed(name):
    budget = 8 if name == "gp" else 24  # a Gaussian process takes its time
    a, b, c = (run(MAKERS[name](seed), budget, 4) for seed in (7, 7, 8))
    assert a.points.shape == (budget, 3) and (abs(a.points) <= 1).all()
    np.testing.assert_array_equal(a.points, b.points)
    assert not np.array_equal(a.points, c.points)


@pytest.mark.slow
@pytest.mark.parametrize("name", LEARNING)
def test_a_search_beats_points_spread_blindly(name):
    budget, seeds = (24, 1) if name == "gp" else (150, 3)
    best = [run(MAKERS[name](seed), budget, 6).score.max() for seed in range(seeds)]
    blind = [run(MAKERS["sobol"](seed), budget, 6).score.max() for seed in range(3)]
    assert np.median(best) > max(blind) and np.median(best) > 0.95


@pytest.mark.parametrize("batch", [1, 7, 64])
def test_evolution_does_not_depend_on_how_many_are_asked_together(batch):
    points = run(DifferentialEvolution(3, 3, population=5), 60, batch).points
    np.testing.assert_array_equal(points, run(DifferentialEvolution(3, 3, population=5), 60, 15).points)


def test_what_goes_wrong_in_the_search_reaches_who_asks(monkeypatch):
    def fails(*_, **__):
        raise TypeError("no argument rng")

    monkeypatch.setattr("scipy.optimize.differential_evolution", fails)
    with pytest.raises(TypeError, match="no argument rng"):
        DifferentialEvolution(2, 0).ask(1)


def test_a_grid_is_full():
    points = run(Grid(3, 0, 130), 125, 25).points
    assert len(np.unique(points, axis=0)) == 125 and set(np.unique(points)) == set(np.linspace(-1, 1, 5))


def test_trials_add_up():
    a, b = tried(np.zeros((2, 3))), tried(PEAK[None])
    both = a + b
    assert len(both) == 3 and both.best == 2 and len(both.info) == 3


def test_a_search_around_a_point_stays_in_its_cube_and_begins_there():
    centre, began = np.array([0.9, 0.0, -0.5]), []

    def make(start):
        began.append(start)
        return Sobol(3, 1)

    search = Around(centre, 0.3, make)
    points = search.ask(64)
    assert (points <= [1.0, 0.3, -0.2]).all() and (points >= [0.6, -0.3, -0.8]).all()
    np.testing.assert_allclose(np.ptp(points, axis=0), [0.4, 0.6, 0.6], atol=0.06)
    np.testing.assert_allclose(began[0], [0.5, 0.0, 0.0])  # of the cube, which the box cuts at 1


def test_after_two_steps_of_a_rule_a_search_starts_at_its_third():
    class Rule:
        told = 0

        def ask(self, n):
            return np.full((1, 3), 0.1 * (1 + self.told))

        def tell(self, trials):
            self.told += 1

    found = run(AfterRule(Rule(), lambda start: NelderMead(3, 0, start, 0.2)), 6, 3)
    np.testing.assert_allclose(found.points[:3], np.repeat([[0.1], [0.2], [0.3]], 3, axis=1))
    assert abs(found.points[3:] - 0.3).max() > 0.1
