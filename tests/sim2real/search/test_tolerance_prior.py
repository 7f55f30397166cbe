"""What the rig states within a tolerance stays known: the tolerance is a prior of the effect on the same parameter."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bench_loop import Bench, write_campaign

from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import RIG_FOLDER, load_rig
from sim2real.compared.point import tolerances
from sim2real.diagnosis import diagnose
from sim2real.free.kinds import Sizes, freed
from sim2real.search import attribute
from sim2real.search.candidates import Attribution, Candidate, best_partial, contradictions
from sim2real.search.fit import Fit
from sim2real.search.hypotheses import (
    EXCLUDED,
    FORM_SHARE,
    IMPOSSIBLE,
    STEEP,
    WIDER,
    Hypothesis,
    added_lag,
    single_effects,
)

HEAVY = Bench(gain=0.3, stiffness=0.3)  # without a force, the same as a mass that is smaller by 23 %


def stated(tmp_path, tolerance: str):
    """The preset hmb_free with another [tolerance], as a file."""
    text = (RIG_FOLDER / "hmb_free.toml").read_text()
    text = re.sub(r"\[tolerance\].*?(?=\n\[)", f"[tolerance]\n{tolerance}\n", text, flags=re.DOTALL)
    (tmp_path / "rig.toml").write_text(text)
    return tmp_path / "rig.toml"


def recorded(tmp_path, bench, tolerance: str, seconds: float = 1.0):
    """A campaign of noise that nobody stored, on a rig that states these tolerances."""
    rig = stated(tmp_path, tolerance)
    folder = write_campaign(tmp_path, bench, {"noise": "fit", "noise-2": "holdout"}, seconds, 0)
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(text.replace('"hmb_free"', f'"{rig.name}"'))
    return folder


def answer(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(attribute, "single_effects", lambda rig: ("mass", "actuator_gain", "negative_stiffness"))
        return diagnose(folder)


def test_a_tolerance_is_a_row_of_the_least_squares():
    h = Hypothesis(("mass", "delay"), {"mass": 0.002, "probe_gain": 0.02})
    assert h.calibrated == ("probe_gain",)
    assert h.prior == pytest.approx([(0.1 / (WIDER * 0.002)) ** 2, 0.0, 1.0])  # a unit of u is 10 % of mass
    assert h.contradicted(np.array([-3.3, 5.0, 0.0])) == ("mass",)
    inside = 0.99 * IMPOSSIBLE * WIDER * 0.002 / 0.1
    assert h.contradicted(np.array([inside, 5.0, 0.0])) == ()
    free = Hypothesis(("mass",), {})
    assert not free.prior.any() and free.contradicted(np.array([-3.3])) == ()


def test_an_effect_alone_soon_contradicts_what_is_stated_and_not_at_once():
    """Of two effects that explain the same, at 15.3 and 14.1 tolerances, neither is beyond the other by much."""
    h, sd = Hypothesis(("mass",), {"mass": 0.005}), WIDER * 0.005 / 0.1  # a unit of u is 10 % of mass
    costs = [h.beyond_stated(np.array([z * sd])) for z in (-2.8, 2.99, 3.06, -4.0)]
    assert costs == pytest.approx([0.0, 0.0, STEEP * 0.06**2, STEEP])
    assert costs[2] < 0.2 and costs[3] > 20.0
    assert Hypothesis(("mass",), {}).beyond_stated(np.array([9.0])) == 0.0


def test_a_number_that_is_simply_wrong_is_no_less_probable_the_farther_it_is_off():
    """The prior is in the cost of a fit, too: with it, all that is far beyond costs the same."""
    h, sd = Hypothesis(("mass",), {"mass": 0.005}), WIDER * 0.005 / 0.1
    whole = [h.beyond_stated(u) + h.prior[0] * u[0] ** 2 for u in np.array([[4.0], [9.0], [-20.0]]) * sd]
    assert whole == pytest.approx([STEEP + 16.0] * 3)
    assert h.contradiction(np.array([9.0 * sd])) == STEEP


def test_a_tolerance_is_about_what_the_rig_s_own_effect_makes_of_the_parameter():
    """An own + 20 % moves by tolerances as the plain rig does, only 1.2 times as far."""
    known, own = {"actuator_gain": 0.01}, effect("actuator_gain", 0.2)
    plain, corrected = (Hypothesis(("actuator_gain", "mass"), known, own=of) for of in ({}, own))
    assert corrected.point(np.zeros(2)).effects["actuator_gain"]["change"] == 0.2
    u = corrected.coordinates[0].at(1.2 * 1.01 - 1)  # the own gain, and 1 % more
    assert corrected.prior[0] * u**2 == pytest.approx(plain.prior[0] * 0.1**2)
    for h, gain in ((plain, 1.0), (corrected, 1.2)):
        lowest, highest = ((1 + side * IMPOSSIBLE * WIDER * 0.01) * gain - 1 for side in (-1, 1))
        assert [h.coordinates[0].low, h.coordinates[0].high] == pytest.approx([lowest, highest])
        for alone in (h.instead("actuator_gain"), h):
            at = [np.array([h.coordinates[0].at(v), 0.0]) for v in (0.99 * highest + 0.01 * lowest, highest)]
            assert [alone.contradicted(v) for v in at] == [(), ("actuator_gain",)]
        assert h.instead("actuator_gain").beyond_stated(np.array([h.coordinates[0].at(1.16 * gain - 1)])) > 1.0
    assert freed(corrected, (), Sizes({}, 0.0)).coordinates == corrected.coordinates


def test_the_dead_part_of_a_lag_comes_on_top_of_the_rig_s_own_delay():
    own = effect("delay", 7e-5)
    h = Hypothesis(("amplifier_lag",), {}, own=own)
    u = np.array([h.coordinates[0].at(1e-4), 0.3 / FORM_SHARE])
    effects = h.point(u).effects
    assert effects["delay"]["time"] == pytest.approx(7e-5 + 3e-5)
    assert added_lag(effects, "amplifier_lag", h.effects, own) == pytest.approx(1e-4)
    without = h.point(np.array([u[0], 0.0])).effects
    assert "delay" not in without and added_lag(without, "amplifier_lag", h.effects, own) == pytest.approx(1e-4)


def test_the_sensors_gain_is_known_by_the_probes():
    h = Hypothesis(("sensor_gain",), {"probe_gain": 0.02})
    assert h.prior[0] == pytest.approx((0.1 / (WIDER * 0.02)) ** 2)


def test_a_lag_may_replace_the_stated_one_instead_of_standing_in_series_with_it():
    h = Hypothesis(("amplifier_lag",), {"amplifier_time_constant": 0.1, "probe_gain": 0.02})
    n = len(h.coordinates)
    assert h.prior[n:] == pytest.approx([WIDER**-2, 1.0, 1.0])  # the last is the form of the lag
    moved = h.bounded(np.concatenate([np.zeros(n), [-20.0, -20.0, 0.0]]))
    assert moved[n : n + 2] == pytest.approx([-9.0, -WIDER * EXCLUDED])
    alone = Hypothesis(("delay",), h.tolerances)
    assert alone.prior[len(alone.coordinates) :] == pytest.approx([1.0, 1.0])


def test_what_is_exact_is_never_tried_and_a_law_without_a_value_has_its_tolerance():
    rig = replace(load_rig("hmb_free"), actuator_gain=None, tolerance={"mass": 0.0, "actuator_gain": 0.05})
    assert "mass" not in single_effects(rig) and "actuator_gain" in single_effects(rig)
    assert tolerances(rig) == {"actuator_gain": 0.05}


def test_a_calibrated_parameter_stays_within_what_is_stated():
    h = Hypothesis((), {"mass": 0.002})
    assert h.bounded(np.array([-165.0])) == pytest.approx([-WIDER * EXCLUDED])


@pytest.mark.slow
def test_a_weighed_mass_is_not_named_for_an_error_of_gain_and_stiffness(tmp_path):
    found = answer(recorded(tmp_path, HEAVY, "mass = 0.002"))
    assert "mass" not in "+".join(found.cause) and found.cause
    assert set(found.cause) >= {"actuator_gain"} or found.verdict == "unexplained"
    free = answer(recorded(tmp_path, HEAVY, "probe_gain = 0.02"))
    assert free.verdict == "explained" and free.cause == ("mass",)


def fitted(effects, u, cost):
    return Candidate(Fit(Hypothesis(effects, {"mass": 0.002}), np.array(u), np.zeros(1), cost))


def test_what_contradicts_the_rig_is_said_and_never_a_partial_explanation():
    rig = SimpleNamespace(nominal=SimpleNamespace(tolerance={"mass": 0.002}))
    calibration, heavy = fitted((), [0.0], 1e5), fitted(("mass",), [-3.3], 1e3)
    late, useless = fitted(("delay",), [1.0, 0.0], 5e4), fitted(("damping",), [1.0, 0.0], 9.7e4)
    problem = SimpleNamespace(parts=[SimpleNamespace(record=rig)])
    found = Attribution(2e5, (calibration, heavy, late, useless), 100.0, problem)
    (said,) = contradictions(found)
    assert said.startswith("mass -33 % would fit better") and "the rig states mass to within 0.2 %" in said
    assert contradictions(found, [("damping", "mass")]) == []
    (said,) = contradictions(found, [("mass",)])
    assert said.endswith("which states mass to within 0.2 % ([tolerance]): measure and correct it")
    assert best_partial(found, None) is late is best_partial(found, 2)
    assert best_partial(found, 3) is calibration  # a damping that explains next to nothing
    formed, little = (
        fitted(("damping", "delay"), [1.0, 1.0, 0.0], 2e4),
        fitted(("damping", "delay"), [1.0, 1.0, 0.0], 4e4),
    )
    assert best_partial(found, 2, formed) is formed and best_partial(found, 2, little) is late


@pytest.mark.parametrize(("saved", "both"), [(20.0, False), (400.0, True)])
def test_a_pair_is_the_partial_explanation_only_where_both_effects_explain_something(saved, both):
    calibration, late = fitted((), [0.0], 1e5), fitted(("delay",), [1.0, 0.0], 5e4)
    pair = fitted(("delay", "damping"), [1.0, 1.0, 0.0], 5e4 - saved)
    found = Attribution(2e5, (calibration, late, pair), 100.0, SimpleNamespace(parts=[]))
    assert best_partial(found, 2) is (pair if both else late)


def test_beside_another_effect_a_stated_parameter_stays_within_what_the_rig_states():
    """Alone it may say that the tolerance is wrong; in a pair it ends, because nearly everything would explain then."""
    alone, beside = (Hypothesis(names, {"mass": 0.002}) for names in (("mass",), ("mass", "damping")))
    assert alone.point(np.array([-3.3])).effects["mass"]["change"] == pytest.approx(-0.33)
    u = beside.bounded(np.array([-3.3, 0.0]))
    assert beside.point(u).effects["mass"]["change"] == pytest.approx(-0.04)
    assert beside.contradicted(u) == ("mass",) and beside.beyond_stated(u) == pytest.approx(STEEP)
    assert beside.contradicted(np.array([-0.39, 0.0])) == ()


def test_a_stated_parameter_that_moved_far_beside_an_effect_is_told():
    h = Hypothesis(("damping",), {"mass": 0.002, "probe_gain": 0.01})
    assert h.strained(np.array([1.0, 2.9, -3.1])) == {"probe_gain": pytest.approx(9.61)}


@pytest.mark.parametrize(("derived", "strains"), [(frozenset(), True), (frozenset({"bias_current"}), False)])
def test_what_follows_from_other_tolerances_contradicts_no_statement(derived, strains):
    h = Hypothesis(("delay",), {"mass": 0.01, "bias_current": 0.02}, derived=derived)
    u = np.array([0.0, *(6.0 if name == "bias_current" else 0.0 for name in h.calibrated)])
    assert ("bias_current" in h.strained(u)) == strains
    assert h.prior[1 + h.calibrated.index("bias_current")] == 1.0  # its prior stays
