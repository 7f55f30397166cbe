"""One value for two axes that differ, or do not."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.rig.rig_file import load_rig
from sim2real import axes_apart
from sim2real.axes_apart import _of_both, along_both
from sim2real.coefficients import Coefficient
from sim2real.compared.point import Point
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis

SAMPLES = 200


def _gain(value: float, se: float) -> Coefficient:
    return Coefficient("actuator_gain", "N/A", value, se, 100.0, True)


def test_an_interval_of_both_axes_reaches_both_where_they_differ():
    both = _of_both(_gain(104.0, 0.2), _gain(96.0, 0.3))
    low, high = both.interval
    assert low < 96.0 - 0.3 and high > 104.0 + 0.3 and both.value == pytest.approx(100.0)
    alike = _of_both(_gain(100.2, 0.2), _gain(99.9, 0.2))
    assert alike.se == 0.2 and 99.9 < alike.value < 100.2


@dataclass(frozen=True)
class _Axes:
    """A problem whose prediction is the gain times a known series along each of two axes."""

    data: np.ndarray
    axis: np.ndarray
    series: np.ndarray

    def simulate(self, points: Sequence[Point]) -> np.ndarray:
        return np.array([(1 + p.effects["actuator_gain"]["change"]) * self.series for p in points])


@pytest.mark.parametrize(("apart", "differ"), [(0.04, True), (0.0, False)])
def test_each_axis_is_fitted_by_what_shows_along_it(monkeypatch, apart, differ):
    rng = np.random.default_rng(1)
    axis = np.repeat([0, 1], SAMPLES)
    series, noise = rng.normal(size=(2, 2 * SAMPLES)) + 1j * rng.normal(size=(2, 2 * SAMPLES))
    factor = np.where(axis == 0, 1 + apart, 1 - apart)
    problem = _Axes(40 * factor * series + noise, axis, 40 * series)
    (fit,) = begin([Hypothesis(("actuator_gain",), {})], [np.zeros(1)], problem.data, problem.simulate)
    iterate([fit], problem.data, problem.simulate, 10)
    differentiate([fit], problem.data, problem.simulate, True)

    def coefficients(rig, problem, fit, others):
        se = float(np.sqrt(fit.covariance()[0, 0])) * 10.0
        return (_gain(100 * (1 + 0.1 * float(fit.u[0])), se),)

    for name in ("coefficients_of", "coefficients_alone"):
        monkeypatch.setattr(axes_apart, name, coefficients)
    rig = replace(load_rig("hmb_radial"), tolerance={})
    (found,), said = along_both(rig, problem, fit, [])
    assert bool(said) is differ
    low, high = found.interval
    for truth in (100 * (1 + apart), 100 * (1 - apart)):
        assert low < truth < high
    assert found.se < 3.0 and along_both(SimpleNamespace(axes=1), problem, fit, [])[1] == ()
