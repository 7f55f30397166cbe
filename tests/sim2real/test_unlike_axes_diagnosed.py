"""Two axes have magnets and probes of their own, each off within its tolerance: that is no gap."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import planned, repeated

from maglev_env.experiment import Experiment
from maglev_env.rig.rig import axis_rig
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.rig_toml import rig_toml
from sim2real.compared.point import APART, TOLERANCE_EFFECTS, Point, apart_tolerances, experiment_at, tolerances
from sim2real.compared.problem import assemble
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis

OFF = {"actuator_gain": 0.05, "negative_stiffness": -0.06, "sensor_gain": 0.01}


def test_a_lag_of_one_axis_is_that_of_y_alone():
    rig = replace(load_rig("hmb_radial"), tolerance={"amplifier_time_constant": 0.1, "mass": 0.01})
    (name,) = apart_tolerances(rig)
    e = experiment_at(Experiment(rig, rig.gains, ()), Point({}, {"amplifier_time_constant": 0.05, name: 0.2}))
    x, y = (axis_rig(e.rig, axis).amplifier_time_constant / rig.amplifier_time_constant for axis in (0, 1))
    assert (x, y) == (pytest.approx(1.05), pytest.approx(1.05 * 1.2))
    assert experiment_at(Experiment(rig, rig.gains, ()), Point({}, {})).rig is rig


def test_one_axis_has_no_other():
    assert apart_tolerances(load_rig("hmb_free")) == {}


@pytest.mark.slow
def test_axes_that_differ_within_their_tolerances_are_calibrated(tmp_path):
    tolerance = {"mass": 0.005, "actuator_gain": 0.03, "negative_stiffness": 0.04, "probe_gain": 0.01}
    rig = replace(load_rig("hmb_free"), axes=2, protocol=None, tolerance=tolerance)
    assert {name.split(" of ")[0] for name in apart_tolerances(rig)} == {*tolerance} - {"mass"}
    (plan,) = planned(load_rig("hmb_free"), names=("base",))
    oblique = tuple(replace(x, direction=35.0) for x in plan.experiment.excitations)
    e = replace(plan.experiment, rig=rig, excitations=oblique, apart=OFF)
    (tmp_path / "both.toml").write_text(rig_toml(rig))
    seeded = [replace(e, seed=seed) for seed in range(2)]
    problem = assemble(repeated(tmp_path / "campaign", seeded, str(tmp_path / "both.toml")))
    h = Hypothesis((), tolerances(rig) | apart_tolerances(rig), scales=rig.scales)
    fits = begin([h], [np.zeros(h.size)], problem.data, problem.simulate)
    iterate(fits, problem.data, problem.simulate, 10)
    differentiate(fits, problem.data, problem.simulate, True)
    (fit,) = fits
    changes, sd = fit.hypothesis.point(fit.u).changes, np.sqrt(np.diag(fit.covariance()))
    for i, name in enumerate(h.calibrated):
        if name.endswith(APART):
            true = OFF[TOLERANCE_EFFECTS[name.removesuffix(APART)]]
            assert abs(changes[name] - true) < 3 * sd[i] * h.sigma(name), name
    expected = 2.0 * problem.data.size
    assert fit.cost < expected + 4 * np.sqrt(2 * expected)
    (plain,) = begin([replace(h, tolerances=tolerances(rig))], [np.zeros(4)], problem.data, problem.simulate)
    iterate([plain], problem.data, problem.simulate, 10)
    assert plain.cost > 5 * expected
