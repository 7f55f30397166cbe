"""CUSUM thresholds against tabulated and simulated run lengths, the charts against a plain loop."""

import numpy as np
import pytest

from estimation.online.change_charts import ChangeCharts, cusum_threshold


@pytest.mark.parametrize("run_length, threshold", [(168, 4.0), (465, 5.0)])
def test_threshold_of_the_tabulated_two_sided_chart(run_length, threshold):
    """Montgomery, Statistical Quality Control: k = 1/2, h = 4 and 5 run 168 and 465 samples in control."""
    assert cusum_threshold(run_length, 0.5, 2) == pytest.approx(threshold, abs=0.02)


@pytest.mark.parametrize("blocks, allowance", [(200, 0.5), (1000, 0.5), (200, 0.25)])
def test_false_alarms_come_at_the_stated_rate(blocks, allowance):
    rng = np.random.default_rng(0)
    threshold = cusum_threshold(blocks, allowance, 4)
    sums, alarms, steps = np.zeros((2000, 2, 2)), 0, 1000
    for _ in range(steps):
        u = rng.normal(size=(2000, 2))
        sums = np.maximum(sums + np.stack([u, -u], axis=1) - allowance, 0)
        hit = (sums > threshold).any(axis=(1, 2))
        sums[hit] = 0
        alarms += hit.sum()
    assert 2000 * steps / alarms == pytest.approx(blocks, rel=0.08)


def test_charts_find_the_direction_and_the_onset_and_start_again():
    charts = ChangeCharts(2, 1e4)
    for time, u in enumerate([0.0, 2.0, -3.0]):
        alarm, onset = charts.update(time, [u, 0.4])
        assert not alarm.any() and np.isnan(onset)
    needed = int(charts.threshold / 1.5) + 1
    for time in range(10, 10 + needed - 1):
        assert not charts.update(time, [0.0, -2.0])[0].any()
    alarm, onset = charts.update(99, [0.0, -2.0])
    assert alarm.tolist() == [False, True] and onset == 10
    assert not charts.update(100, [0.0, -2.0])[0].any()


@pytest.mark.parametrize(
    "given, text",
    [
        ((0.5, 0.5, 4), "one false alarm in 0.5 blocks is not possible"),
        ((np.nan, 0.5, 1), "one false alarm in nan"),
        ((1e3, 0.0, 1), "allowance = 0.0"),
        ((1e3, 0.5, 0), "charts = 0"),
    ],
)
def test_bad_input(given, text):
    with pytest.raises(ValueError, match=text):
        cusum_threshold(*given)
