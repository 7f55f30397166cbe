"""The regret of recommended gains: twin and simulator score alike, and a right diagnosis chooses better gains."""

from dataclasses import replace

import numpy as np
import pytest
from sealed_sets import diagnosis

from maglev_env.evaluation.evaluate import evaluate
from maglev_env.experiment import protocol_experiment
from maglev_env.loop.gains import with_gains
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.protocol import env_protocol
from sim2real.advice import gain_choice
from sim2real.advice.gain_choice import FACTORS
from sim2real.blind.cases import Hypothesis, parse_diagnosis
from sim2real.blind.judging.regret import CaseRegret, case_regret, corrected_point, correction, regret_row, twin_score
from sim2real.blind.twin import Truth
from sim2real.compared.point import Point


def answered(cause, which):
    """An answer that explains by `cause`; which: {"a": (probability, {"a.parameter": value})}."""
    given = parse_diagnosis(diagnosis("explained", cause), 1.0, "v")
    return replace(given, which=tuple(Hypothesis(frozenset(k.split("+")), p, v) for k, (p, v) in which.items()))


def test_the_correction_is_the_most_probable_member_of_the_cause_with_its_parameters():
    rig = load_rig("hmb_free")
    which = {
        "mass": (0.6, {"mass.change": 0.1}),
        "delay+eddy_current": (0.4, {"delay.time": 5e-5, "eddy_current.corner_hz": 300.0, "mass.change": 0.002}),
    }
    found = correction(answered(["delay", "eddy_current"], which), rig)
    assert found == {"delay": {"time": 5e-5}, "eddy_current": {"corner_hz": 300.0, "order": 0.5}}
    assert correction(answered(["damping"], which), rig) == {}  # named, but without an entry
    assert correction(parse_diagnosis(diagnosis("no_gap"), 1.0, "v"), rig) == {}
    assert correction(answered(["delay"], {"delay": (1.0, {"delay.time": 5.0})}), rig) == {}  # out of bounds
    support = answered(["support_stiffness"], {"support_stiffness": (1.0, {"support_stiffness.change": 0.1})})
    assert correction(support, rig) == {}  # no support on this rig


def test_an_answer_that_names_nothing_corrects_nothing():
    """Not even parameters, which a diagnosis writes into the corrected rig as far as calibration explains the gap."""
    rig, changes = load_rig("hmb_free"), {"actuator_gain": -0.08}
    for verdict in ("unexplained", "no_gap"):
        given = parse_diagnosis(diagnosis(verdict) | {"corrected": {"effects": {}, "changes": changes}}, 1.0, "v")
        assert corrected_point(given, rig) == Point({}, {})
    named = replace(answered(["mass"], {"mass": (1.0, {"mass.change": 0.1})}), changes=changes)
    assert corrected_point(named, rig) == Point({"mass": {"change": 0.1}}, changes)


def test_the_sum_of_regrets_is_compared():
    cases = [CaseRegret("a", 0.9, 0.5, 0.8), CaseRegret("b", 0.7, 0.5, 0.7), CaseRegret("c", 0.6, 0.6, 0.5)]
    row = regret_row(cases)
    assert row.value == pytest.approx(0.2 / 0.6 - 1) and row.n == 3 and row.verdict == "floor" and not row.decided
    assert regret_row([CaseRegret("a", 0.9, 0.5, 0.9)] * 5).verdict == "ambitious"
    assert regret_row([CaseRegret("a", 0.9, 0.9, 0.9)]).value == 0.0
    assert regret_row([]).verdict == "no cases"


def quick():
    """A rig of the twin under the protocol that takes an eighth of the time."""
    rig = load_rig("hmb_free")
    return replace(rig, protocol=env_protocol(rig, "quick"))


@pytest.mark.slow
def test_an_undisturbed_twin_scores_as_the_simulator_does():
    rig = quick()
    gains = [with_gains(rig.gains, kp=kp * rig.gains.kp, kd=kd * rig.gains.kd) for kp, kd in FACTORS[4:7]]
    planned = [protocol_experiment(rig, g) for g in gains]
    own = evaluate(planned).score
    twin = np.array([twin_score(e, Truth("hmb_free")) for e in planned])
    assert np.ptp(own) > 0.2  # the sets differ by far more than the two may
    assert twin == pytest.approx(own, abs=0.03) and np.argmax(twin) == np.argmax(own)


@pytest.mark.slow
def test_the_right_diagnosis_recommends_better_gains_than_none(monkeypatch):
    monkeypatch.setattr(gain_choice, "FACTORS", FACTORS[4:])  # enough to choose from
    rig = quick()
    truth = Truth("hmb_free", effects={"actuator_gain": {"change": -0.3}})
    right = answered(["actuator_gain"], {"actuator_gain": (1.0, {"actuator_gain.change": -0.3})})
    found = case_regret(right, rig, truth, "c0001")
    assert found.best == pytest.approx(found.corrected, abs=0.02) and found.nominal < found.corrected - 0.1
