"""Intervals over recordings that disagree, against the scatter of simulated pooled values."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.experiment import Experiment
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real.blind.benchmark.rigs import draw_rig
from sim2real.coefficients import (
    Coefficient,
    across_recordings,
    change_at,
    coefficients_of,
    least_spread,
    nominal_coefficient,
    standard_errors,
)
from sim2real.recorded.at_rest.static_evidence import coefficients_at
from sim2real.search.fit import Fit, cost_of
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.valleys import CHANCE


def _of(value, se):
    return Coefficient("actuator_gain", "N/A", float(value), float(se), 1.0, True)


def test_recordings_with_errors_of_their_own_widen_the_interval_to_cover_them():
    se, rng, z = np.array([0.01, 0.02, 0.04, 0.04, 0.05, 0.08]), np.random.default_rng(1), []
    weight = se**-2 / np.sum(se**-2)
    for _ in range(2000):
        values = 1 + 5 * se * rng.standard_normal(se.size)  # five times what they state
        whole = _of(values @ weight, np.sum(se**-2) ** -0.5)
        wider = across_recordings(whole, [_of(v, s) for v, s in zip(values, se, strict=True)])
        z.append((whole.value - 1) / wider.se)
    assert 0.85 < np.mean(np.abs(z) < 1.96) < 0.99 and np.mean(z) == pytest.approx(0, abs=0.1)


def test_a_recording_that_tells_little_does_not_undo_what_the_others_tell():
    whole = _of(1.0, 0.01)
    assert across_recordings(whole, [_of(1.0, 0.01), _of(1.0, 0.02), _of(0.3, 0.1)]).se < 5 * whole.se


@pytest.mark.parametrize("power", [1, 2])
def test_an_interval_excludes_a_point_no_more_than_the_likelihood_does(power):
    # With the square of a coordinate, the data tell nothing of it where it is zero, but the curvature at a fit does.
    rng, h, sd = np.random.default_rng(2), Hypothesis(("damping",), {}), 1 / np.sqrt(20)
    wald, least = [], []
    for _ in range(1000):
        data = rng.standard_normal(20) + 1j * rng.standard_normal(20)
        mean = float(data.real.mean())
        u = np.sign(mean) * abs(mean) ** (1 / power)
        best, true = (Fit(h, np.array([v]), data - p, cost_of(data - p, np.zeros(1), np.zeros(1)))
                      for v, p in ((u, mean), (0.0, 0.0)))  # fmt: skip
        wald.append(sd / (power * abs(u) ** (power - 1)))
        least.append(abs(u) / max(wald[-1], float(least_spread(best, true)[0])))
        assert power > 1 or least_spread(best, true)[0] < wald[-1]  # a straight line needs no widening
    assert np.mean(np.array(least) < 1.96) > 0.91


def test_an_interval_of_a_time_begins_at_zero():
    delay = Coefficient("delay", "s", 2e-6, 3e-6, 0.0, True)
    assert delay.interval[0] == 0.0 and delay.interval[1] == pytest.approx(2e-6 + 1.96 * 3e-6, rel=1e-3)


def test_a_peak_that_another_point_does_not_bear_out_may_be_one_of_noise():
    """From a parabola the least spread is that of its curvature; where the cost rises less, chance is taken off."""
    h = Hypothesis(("damping",), {})
    curvature = np.array([0.1])

    def spread(rise):
        fit, other = (Fit(h, np.array([u]), np.zeros(1, complex), cost) for u, cost in ((1.0, 0.0), (0.0, rise)))
        return float(standard_errors(curvature, fit, [other])[0])

    assert spread(100.0) == pytest.approx(0.1)  # (1 / 0.1)^2
    assert spread(60.0) == pytest.approx(60.3**-0.5)
    assert spread(40.0) == pytest.approx((40.0 - CHANCE + 0.3) ** -0.5)
    assert spread(9.0) > 1


FREE = load_rig("hmb_free")
BALL = rig_from_toml(draw_rig("ball", np.random.default_rng(3)).toml(), "rig.toml")
OWN = {
    **effect("actuator_gain", 0.1, force_share=0.5),
    **effect("negative_stiffness", -0.2, distance_share=0.3),
    **effect("force_law", 0.5, offset=0.1),
    **effect("damping", 0.4),
    **effect("delay", 75e-6),
}


@pytest.mark.parametrize("own", ({}, OWN), ids=("plain", "corrected"))
@pytest.mark.parametrize("rig", (FREE, BALL), ids=("pair", "single"))
def test_the_nominal_values_are_those_of_the_linear_loop_with_the_rig_s_own_effects(rig, own):
    rig = replace(rig, effects=own)
    linear = coefficients_at(Experiment(rig, Gains(kp=1e4, ki=0.0, kd=10.0), ()))
    nominal = [nominal_coefficient(rig, of) for of in ("actuator_gain", "negative_stiffness")]
    assert nominal == pytest.approx(linear - [0.0, rig.support_stiffness], rel=1e-6)


def test_a_fit_that_finds_the_rig_s_own_effects_tells_no_change():
    rig = replace(FREE, effects=OWN)
    h = Hypothesis(("actuator_gain", "negative_stiffness", "damping", "delay"), {}, scales=rig.scales)
    u = np.array([c.at(OWN[c.effect][c.parameter]) for c in h.coordinates])
    fit = Fit(h, u, np.zeros(h.size, complex), 0.0, 1e3 * np.eye(h.size, dtype=complex))
    found = coefficients_of(rig, SimpleNamespace(parts=()), fit, ())
    assert [c.value for c in found] == pytest.approx([c.nominal for c in found], rel=1e-9)
    assert found[-1].nominal == 75e-6 and found[2].nominal == rig.support_damping + 0.4
    moved = replace(found[0], value=found[0].nominal * 1.05)
    assert change_at(rig, moved) == pytest.approx(1.1 * 1.05 - 1)
