"""One value for two axes that differ, or do not."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.rig.rig_file import load_rig
from sim2real import axes_apart, coefficients
from sim2real.axes_apart import _of_both, along_both
from sim2real.coefficients import Coefficient
from sim2real.compared.point import Point
from sim2real.search.fit import Fit
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


@pytest.mark.parametrize(("more", "differ"), [(0.02, False), (-0.02, True)])
def test_axes_of_other_stated_values_agree_where_both_are_as_far_from_them(monkeypatch, more, differ):
    stated = [replace(_gain(90.0 * 1.02, 0.3), nominal=90.0), replace(_gain(110.0 * (1 + more), 0.3), nominal=110.0)]
    monkeypatch.setattr(axes_apart, "coefficients_of", lambda *of: (_gain(100.0 * (1 + more), 0.2),))
    monkeypatch.setattr(axes_apart, "_along", lambda rig, problem, fit, axis: (stated[axis],))
    (found,), said = along_both(load_rig("hmb_radial"), None, None, [])
    assert any("the rig states other values of its axes" in text for text in said)
    assert any("no value holds for both" in text for text in said) is differ
    assert found.nominal == 100.0 and (differ or found.value == pytest.approx(102.0))


def test_an_axis_is_widened_by_its_own_misfit_once(monkeypatch):
    """Half of the data leaves four times its noise, and the other half is none of this fit."""
    monkeypatch.setattr(coefficients, "widening", lambda problem, fit: np.ones(1))
    hypothesis = Hypothesis(("actuator_gain",), {})
    residual = np.concatenate([np.full(400, 2.0 + 2.0j), np.zeros(400)])
    jacobian = np.concatenate([np.full(400, 50.0 + 0j), np.zeros(400)])[None]
    fit = Fit(hypothesis, np.zeros(1), residual, 1.0, jacobian)
    rig = load_rig("hmb_free")
    (half,) = coefficients.coefficients_of(rig, None, fit, [], 0.5)
    (plain,) = coefficients.coefficients_of(rig, None, replace(fit, residual=residual / 2), [], 0.5)
    assert half.se == pytest.approx(2 * plain.se)


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

    def told(rig, problem, fit, others, share=1.0):
        se = float(np.sqrt(fit.covariance()[0, 0])) * 10.0
        return (_gain(100 * (1 + 0.1 * float(fit.u[0])), se),)

    monkeypatch.setattr(axes_apart, "coefficients_of", told)
    rig = replace(load_rig("hmb_radial"), tolerance={})
    (found,), said = along_both(rig, problem, fit, [])
    assert bool(said) is differ
    low, high = found.interval
    for truth in (100 * (1 + apart), 100 * (1 - apart)):
        assert low < truth < high
    assert found.se < 3.0 and along_both(SimpleNamespace(axes=1), problem, fit, [])[1] == ()
