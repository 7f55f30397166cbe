"""What is not known of a force law's shape, beside any law that a fit may end at."""

import ball_bench
import numpy as np
import pytest
from ball_bench import BALL
from scipy import signal

from maglev_env.experiment import Experiment
from maglev_env.lane_values import shaped_law
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force, linearise, reshaped
from maglev_env.recordings.campaign import load_campaign
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import rig_from_toml
from sim2real.compared.law_shape import BEND, FORM_NAME, STEEPNESS_NAME, bent, law_shapes, shape_directions
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.recorded.records import read_records


@pytest.mark.parametrize("exponent", [-1.5, 0.0, 3.0, 34.0, 40.0])
@pytest.mark.parametrize("offset", [-0.6, 0.0, 12.0, 20.0])
@pytest.mark.parametrize("centre", [0.0, 4e-4])
def test_every_shape_is_a_law_of_the_same_gain_and_stiffness_at_rest(exponent, offset, centre):
    rig = rig_from_toml(BALL, "ball.toml")
    effects = {"force_law": {"exponent": exponent, "offset": offset}, "eccentricity": {"offset": centre}}
    near = Point(effects | {"actuator_gain": {"change": 0.2}}, {})
    law = force_law(rig)
    gain, stiffness = linearise(reshaped(law, exponent, offset), centre)
    for point in law_shapes(rig, near).values():
        bent = point.effects["force_law"]
        other = linearise(reshaped(law, **bent), centre)
        assert other[0] * (1 + point.effects["actuator_gain"]["change"]) == pytest.approx(1.2 * gain, rel=1e-9)
        assert other[1] * (1 + point.effects["negative_stiffness"]["change"]) == pytest.approx(stiffness, rel=1e-9)
        assert bent != near.effects["force_law"]
        Experiment(rig, rig.gains, (), effects=point.effects)


def test_a_shape_leaves_gain_and_stiffness_within_their_tolerances_where_they_are():
    rig = rig_from_toml(BALL, "ball.toml")
    changes = {"actuator_gain": 0.05, "negative_stiffness": 0.08, "mass": 0.01}
    for name, point in law_shapes(rig, Point({}, changes)).items():
        assert point.effects["actuator_gain"]["change"] == pytest.approx(0.05)
        if name == "form of the force law":  # from one steepness to the same
            assert point.effects["negative_stiffness"]["change"] == pytest.approx(0.08)
        assert point.changes == changes
        beside = law_shapes(rig, Point({"actuator_gain": {"change": 0.3}}, changes))[name]
        assert beside.effects["actuator_gain"]["change"] == pytest.approx(0.3), "the effect stands for its tolerance"


def test_the_form_of_a_stiffness_stays_beside_every_shape_of_the_law():
    rig = rig_from_toml(BALL, "ball.toml")
    near = Point({"negative_stiffness": {"change": 0.3, "distance_share": 1.0}}, {})
    for point in law_shapes(rig, near).values():
        assert point.effects["negative_stiffness"]["distance_share"] == 1.0


def test_a_bent_law_has_the_gain_and_stiffness_at_rest_of_the_rig():
    rig = rig_from_toml(BALL, "ball.toml")
    was = force_law(rig)
    other = bent(rig, {FORM_NAME: 1.5, STEEPNESS_NAME: -0.5})
    now = shaped_law(force_law(other), other.effects)
    assert linearise(now) == pytest.approx(linearise(was), rel=1e-9)
    far = 0.4 * rig.gap
    assert abs(force(now, far, 0.0) / force(was, far, 0.0) - 1) > 0.02
    assert bent(rig, {FORM_NAME: 100.0}) is rig, "no law has that shape"


@pytest.mark.slow
def test_a_problem_about_a_bent_law_holds_the_same_evidence_of_its_shape(tmp_path):
    rig = rig_from_toml(BALL, "ball.toml")
    rng = np.random.default_rng(5)
    injection = 0.2 * signal.lfilter(*signal.butter(2, 20.0, fs=rig.control_rate), rng.normal(size=1000))
    run = ball_bench.record(rig, 1.0, 3, injection)
    controller = BALL.partition("[gains]\n")[2].split("#")[0].strip()
    inline = "{ " + ", ".join(line.partition("#")[0].strip() for line in controller.splitlines()) + " }"
    ball_bench.write_campaign(tmp_path, BALL, inline, {"noise": run})
    (record,) = read_records(load_campaign(tmp_path))[1]
    here = Point({}, {})
    plain = assemble([record], near=here)
    about = plain.with_errors(here, {FORM_NAME: -0.15, STEEPNESS_NAME: 0.15})
    told, same = (p.nuisances.amounts(p.data - p.simulate([here])[0]) for p in (plain, about))
    for name in (FORM_NAME, STEEPNESS_NAME):
        assert same[name] == pytest.approx(told[name], abs=0.075)


def test_magnets_without_a_stiffness_keep_none_under_every_shape():
    rig = Rig(name="repelled", magnet="electromagnet_pair", mass=0.12, gap=0.02, bias_current=0.9, actuator_gain=1.3,
              negative_stiffness=-0.0, support_stiffness=50.0)  # fmt: skip
    for point in law_shapes(rig, Point({}, {})).values():
        assert point.effects["negative_stiffness"]["change"] == 0.0
        assert point.effects["actuator_gain"]["change"] == pytest.approx(0.0, abs=0.5)


@pytest.mark.parametrize("name", [FORM_NAME, STEEPNESS_NAME])
def test_a_bent_law_has_room_to_bend_on(name):
    """A recording may ask for much; the directions of the shape are then looked at beside that law."""
    rig = rig_from_toml(BALL, "ball.toml")
    moved = 0
    for amount in np.linspace(-12.0, 12.0, 97):
        own = bent(rig, {name: amount})
        moved += own is not rig
        for point in law_shapes(own, Point({}, {}), shape_directions(rig), BEND).values():
            Experiment(rig, rig.gains, (), effects=point.effects)
    assert 10 < moved < 97
