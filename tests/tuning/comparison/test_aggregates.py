"""Aggregates over rigs: what they are by hand, and intervals that cover as often as they say."""

import numpy as np
import pytest
from scipy.stats import norm

from tuning.comparison.aggregates import (
    LEAST,
    improvement,
    interquartile_mean,
    median,
    performance_profile,
    resamples,
)

N = 24


def test_values_are_those_by_hand():
    draws = resamples(4, 0)
    values = np.array([[8.0, 1.0], [2.0, 7.0], [3.0, 6.0], [100.0, 5.0]])
    assert median(values, draws)[0] == 5.5
    assert interquartile_mean(values, draws)[0] == np.mean([3, 5, 6, 7])  # of 1 2 | 3 5 6 7 | 8 100
    np.testing.assert_allclose(performance_profile(values, np.array([1.0, 5.5, 200.0]), draws)[0], [0, 0.5, 1])
    other = np.array([[8.0], [8.0], [3.0], [1.0]])
    assert improvement(values, other, draws)[0] == np.mean([0.75, 1, 0.25, 0])


def test_the_other_way_round_the_probability_is_the_rest():
    rng = np.random.default_rng(0)
    one, other = rng.integers(5, size=(2, N, 3)).astype(float)
    draws = resamples(N, 1)
    there, back = improvement(one, other, draws), improvement(other, one, draws)
    np.testing.assert_allclose(there, 1 - back[[0, 2, 1]], atol=1e-12)


def test_rigs_that_all_agree_do_not_make_certain():
    draws = resamples(10, 0)
    better = improvement(np.zeros((10, 2)), np.ones((10, 2)), draws)
    np.testing.assert_allclose(better, [1, 0.025**0.1, 1])
    np.testing.assert_allclose(
        performance_profile(np.ones((10, 1)), np.array([0.5]), draws)[:, 0], [0, 0, 1 - 0.025**0.1]
    )


def test_one_rig_says_nothing_of_others():
    draws = resamples(1, 0)
    for figure in (median, interquartile_mean):
        found = figure(np.array([[0.3, 0.3]]), draws)
        assert found[0] == pytest.approx(0.3) and np.isnan(found[1:]).all()
    np.testing.assert_allclose(improvement(np.zeros((1, 1)), np.ones((1, 1)), draws), [1, 0.025, 1])
    np.testing.assert_allclose(improvement(np.zeros((1, 1)), np.zeros((1, 1)), draws), [0.5, 0, 1])


def test_few_rigs_tell_no_interval_of_their_middle():
    """Of 2 rigs 52 % of such intervals had held the median of all, of 3 rigs 71 %."""
    rng = np.random.default_rng(0)
    for figure in (median, interquartile_mean):
        few, enough = (figure(rng.standard_normal((n, 2)), resamples(n, 0)) for n in (LEAST - 1, LEAST))
        assert np.isfinite(few[0]) and np.isnan(few[1:]).all() and np.isfinite(enough).all()


def test_the_median_of_the_fewest_rigs_is_covered():
    rng, runs = np.random.default_rng(1), 400
    draws = resamples(LEAST, 0)[:500]
    found = [median(rng.standard_normal((LEAST, 1)), draws) for _ in range(runs)]
    assert np.mean([low <= 0 <= high for _, low, high in found]) > 0.92


@pytest.mark.slow
def test_intervals_cover_as_often_as_they_say(monkeypatch):
    """Log-normal regrets, most of whose spread is between the rigs: as if 4 repeats were 4 rigs, 70 % would cover."""
    monkeypatch.setattr("tuning.comparison.aggregates.RESAMPLES", 500)
    between, within, shift, threshold, runs = 1.0, 0.5, 0.4, 0.8, 300
    total = np.hypot(between, within)
    quarter = total * norm.ppf(0.75)
    truth = {
        "median": 1.0,
        # Mean of exp(total z) for z between its quartiles.
        "iqm": 2 * np.exp(total**2 / 2) * np.diff(norm.cdf(np.array([-quarter, quarter]) / total - total))[0],
        "profile": norm.cdf(np.log(threshold) / total),
        "better": norm.cdf(shift / np.sqrt(2 * within**2)),
    }
    rng, covered = np.random.default_rng(0), dict.fromkeys(truth, 0)
    for i in range(runs):
        rig = between * rng.standard_normal((N, 1))
        one, other = (np.exp(rig + d + within * rng.standard_normal((N, 4))) for d in (0.0, shift))
        draws = resamples(N, i)
        found = {
            "median": median(one, draws),
            "iqm": interquartile_mean(one, draws),
            "profile": performance_profile(one, np.array([threshold]), draws)[:, 0],
            "better": improvement(one, other, draws),
        }
        for name, (_, low, high) in found.items():
            covered[name] += low <= truth[name] <= high
    for name, count in covered.items():
        assert 0.91 <= count / runs <= 0.98, (name, count / runs)
