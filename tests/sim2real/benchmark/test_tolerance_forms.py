"""Rigs whose gain or stiffness is off within its tolerance, in the form of another hand's magnet."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.experiment import Experiment
from maglev_env.lane_values import shaped_law
from maglev_env.loop.effect import EFFECTS
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force, linearise, reshaped
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real.blind.benchmark import at
from sim2real.blind.benchmark.drives import draw_drive
from sim2real.blind.benchmark.plant import pull
from sim2real.blind.benchmark.rigs import draw_rig
from sim2real.blind.benchmark.simulate import Controller, Recording, Truth, simulate
from sim2real.blind.benchmark.write import Recorded, write_campaign
from sim2real.compared import problem as problem_module
from sim2real.compared.point import Point, tolerances
from sim2real.compared.tolerance_forms import LAG, tolerance_forms
from sim2real.recorded.records import read_records
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis


def on(rig):
    return Experiment(rig, NO_CONTROLLER, ())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    rng = np.random.default_rng(3)
    rig = draw_rig("ball", rng)
    rig = replace(rig, noise={**rig.noise, "displacement": 4e-5 * rig.parameters["gap"]})
    controller = Controller(rig.pid, "pid", 1 / rig.parameters["control_rate"])
    recording = Recording("one", "fit", controller, draw_drive("multisine", rig, False, 0.08, rng))
    made = simulate(Truth(rig, {"negative_stiffness": -0.04}), recording, 5)
    folder = tmp_path_factory.mktemp("ball") / "c"
    write_campaign(folder, rig, "no_force", [Recorded(recording, True, made)])
    return folder


def test_both_forms_have_the_same_stiffness_and_another_curvature(folder):
    rig = load_rig(folder / "rig.toml")
    (scaled, steeper, deviations), law = tolerance_forms(on(rig))["negative_stiffness"], force_law(rig)
    more = 0.04 * deviations
    assert 0 < more < 0.04 and scaled.effects["negative_stiffness"]["change"] == pytest.approx(more)
    other = reshaped(law, steeper.effects["force_law"]["exponent"], 0.0)
    assert linearise(other)[1] == pytest.approx((1 + more) * linearise(law)[1], rel=1e-9)
    assert linearise(other)[0] == pytest.approx(linearise(law)[0], rel=1e-12)
    y = 0.1 * rig.gap
    same = replace(law, stiffness_scale=1 + more)
    assert abs(force(other, y, 0.0) - force(same, y, 0.0)) > 0.025 * more * force(law, y, 0.0)


@pytest.mark.parametrize("end", ["low", "high"])
def test_a_law_at_the_end_of_its_range_is_asked_from_within(folder, end):
    """A fit that ended there had asked for an exponent beyond it, and the diagnosis ended in an error."""
    rig, exponent = load_rig(folder / "rig.toml"), EFFECTS["force_law"].parameters["exponent"]
    near = Point({"force_law": {"exponent": getattr(exponent, end), "offset": 0.0}}, {})
    scaled, bent, deviations = tolerance_forms(on(rig), near)["negative_stiffness"]
    assert exponent.low <= bent.effects["force_law"]["exponent"] <= exponent.high
    # Both are off by the same share, of the same sign.
    law = reshaped(force_law(rig), near.effects["force_law"]["exponent"], 0.0)
    more = 0.04 * deviations
    assert scaled.effects["negative_stiffness"]["change"] == pytest.approx(more)
    other = reshaped(force_law(rig), bent.effects["force_law"]["exponent"], 0.0)
    assert linearise(other)[1] == pytest.approx((1 + more) * linearise(law)[1], rel=1e-6)


def test_between_opposed_magnets_the_forms_differ_while_the_motion_is_large():
    rig = draw_rig("rotor", np.random.default_rng(4))
    plain = rig_from_toml(rig.toml(), "rig.toml")
    scaled, nearer, _ = tolerance_forms(on(plain))["negative_stiffness"]
    change = scaled.effects["negative_stiffness"]["change"]
    one = replace(force_law(plain), stiffness_scale=1 + change)
    other = shaped_law(force_law(plain), nearer.effects)
    other = replace(other, stiffness_scale=other.stiffness_scale * (1 + change))  # the change itself: see `shaped_law`
    pair = Truth(rig, {"negative_stiffness": change}).values(0.0, 0.0)
    assert linearise(one)[1] == pytest.approx(linearise(other)[1], rel=1e-12)
    for y in (0.001 * plain.gap, 0.1 * plain.gap):
        assert force(other, y, 0.2) == pytest.approx(pull(0.2, y, pair), rel=1e-9)
    assert abs(force(one, 0.1 * plain.gap, 0.2) / pull(0.2, 0.1 * plain.gap, pair) - 1) > 1e-5


@pytest.fixture(scope="module")
def stand(tmp_path_factory):
    rng = np.random.default_rng(3)
    rig = draw_rig("stand", rng)
    controller = Controller(rig.pid, "pid", 1 / rig.parameters["control_rate"])
    recording = Recording("one", "fit", controller, draw_drive("multisine", rig, False, 0.05, rng))
    made = simulate(Truth(rig, {"negative_stiffness": -0.09}), recording, 5)
    folder = tmp_path_factory.mktemp("stand") / "c"
    write_campaign(folder, rig, "no_force", [Recorded(recording, True, made)])
    return folder


@pytest.mark.parametrize(("kind", "more"), [("folder", 2.0), ("stand", 1.5)])
def test_calibration_takes_up_a_stiffness_of_another_form(kind, more, request, monkeypatch):
    _, (record,) = read_records(request.getfixturevalue(kind))
    left = {}
    for known in (False, True):
        with monkeypatch.context() as patch:
            if not known:
                patch.setattr(problem_module, "form_nuisances", lambda *known: {})
            problem = problem_module.assemble([record], rest=False)
        h = Hypothesis((), tolerances(record.nominal), scales=record.nominal.scales)
        (fit,) = begin([h], [np.zeros(h.size)], problem.data, problem.simulate)
        iterate([fit], problem.data, problem.simulate, 8)
        left[known] = fit.cost / (2 * problem.data.size)
    assert left[True] < 1.3 and left[False] > more * left[True], left


@pytest.mark.parametrize("for_estimate", [False, True])
def test_a_diagnosis_knows_the_form_of_no_stiffness_wherever_it_bends_the_law(tmp_path, for_estimate):
    """About a law that was bent for an effect, what is unsure of its shape no longer has the form of a stiffness."""
    rng = np.random.default_rng(3)
    rig = draw_rig("ball", rng)
    controller = Controller(rig.pid, "pid", 1 / rig.parameters["control_rate"])
    recording = Recording("one", "fit", controller, draw_drive("chirp", rig, False, 0.05, rng))
    made = simulate(Truth(rig, {}), recording, 5)
    write_campaign(tmp_path / "c", rig, "no_force", [Recorded(recording, True, made)])
    _, records = read_records(tmp_path / "c")
    problem = problem_module.assemble(records, rest=False, for_estimate=for_estimate)
    assert "form of the force law" in problem.nuisances.names
    assert ("form of negative_stiffness" in problem.nuisances.names) != for_estimate


@pytest.mark.parametrize("stated", [None, 0.1, 0.0])
def test_a_stated_lag_has_no_stated_form_and_the_same_time(stated):
    rig = rig_from_toml(draw_rig("rotor", np.random.default_rng(4)).toml(), "rig.toml")
    rig = rig if stated is None else replace(rig, tolerance={**rig.tolerance, LAG: stated})
    forms = tolerance_forms(on(rig), lag_is_sure=False)
    assert LAG not in tolerance_forms(on(rig)) and (LAG in forms) == (stated != 0.0)
    if LAG in forms:
        plain, two, _ = forms[LAG]
        assert plain.effects == {} and plain.changes == {}
        second = two.effects["amplifier_lag"]["time_constant"]
        assert second + (1 + two.changes[LAG]) * getattr(rig, LAG) == pytest.approx(getattr(rig, LAG))


def test_calibration_takes_up_a_lag_of_several_poles(tmp_path, monkeypatch):
    """Half of the stated time in two further poles, by another hand's integrator; an estimate takes it as stated."""
    rng = np.random.default_rng(5)
    rig = draw_rig("rotor", rng)
    controller = Controller(rig.pid, "pid", 1 / rig.parameters["control_rate"])
    recording = Recording("one", "fit", controller, draw_drive("multisine", rig, False, 0.03, rng))
    half = 0.5 * rig.parameters[LAG]
    made = simulate(Truth(rig, {}, {at.AMPLIFIER: -half, at.LAG: half}), recording, 5)
    write_campaign(tmp_path / "c", rig, "no_force", [Recorded(recording, True, made)])
    _, (record,) = read_records(tmp_path / "c")
    left = {}
    for for_estimate in (False, True):
        problem = problem_module.assemble([record], rest=False, for_estimate=for_estimate)
        h = Hypothesis((), tolerances(record.nominal), scales=record.nominal.scales)
        (fit,) = begin([h], [np.zeros(h.size)], problem.data, problem.simulate)
        iterate([fit], problem.data, problem.simulate, 8)
        left[for_estimate] = fit.cost / (2 * problem.data.size)
    assert left[False] < 1.3 and left[True] > 2 * left[False], left
