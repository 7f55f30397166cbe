"""A holdout that tells what the fitted recordings leave open, on linear problems that are solved in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest

import sim2real.judgement.on_holdout as module
from sim2real.gap.shrink import left_on
from sim2real.judgement.judge import Entry
from sim2real.judgement.on_holdout import (
    calibration_fails,
    leaves_clear_gap,
    leaves_too_much,
    shown_by_both,
    spoken_against,
)
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis

RNG = np.random.default_rng(8)
TOLERANCES = {"mass": 0.005, "actuator_gain": 0.02}
HEAVIER = 0.07  # 14 of the tolerances of the mass, 3.5 of those of the gain


def noise(n):
    return RNG.standard_normal(n) + 1j * RNG.standard_normal(n)


def problem(rows, mass):
    """A recording whose values are rows (n, 2) @ (relative mass, relative gain), with noise."""

    def simulate(points):
        every = [
            (p.effects.get("mass", {}).get("change", 0.0) + p.changes.get("mass", 0.0), p.changes["actuator_gain"])
            for p in points
        ]
        return np.array(every) @ rows.T + 0j

    return SimpleNamespace(data=rows @ (mass, 0.0) + noise(len(rows)), simulate=simulate, louder=1.0)


def fitted(recording, effects=(), tolerances=TOLERANCES):
    h = Hypothesis(effects, tolerances)
    (fit,) = begin([h], [np.zeros(h.size)], recording.data, recording.simulate)
    iterate([fit], recording.data, recording.simulate, 20)
    differentiate([fit], recording.data, recording.simulate, True)
    return fit


# A drive of the current tells gain over mass alone; a force tells the mass.
BY_CURRENT = 3e3 * np.outer(np.linspace(0.5, 1.0, 200), (-1.0, 1.0))
BY_FORCE = 1e3 * np.outer(np.linspace(0.5, 1.0, 200), (-1.0, 0.0))


def test_what_is_left_is_the_least_cost_of_both_less_that_of_the_fitted():
    one, other = problem(BY_CURRENT, HEAVIER), problem(BY_FORCE, HEAVIER)
    fit = fitted(one)
    sigma = np.array([TOLERANCES[name] for name in fit.hypothesis.calibrated])
    order = [("mass", "actuator_gain").index(name) for name in fit.hypothesis.calibrated]
    rows = np.concatenate([BY_CURRENT, BY_FORCE])[:, order] * sigma
    every = np.concatenate([np.concatenate([one.data, other.data]).real, np.zeros(2)])
    u, *_ = np.linalg.lstsq(np.concatenate([rows, np.eye(2)]), every, rcond=None)
    left = every - np.concatenate([rows, np.eye(2)]) @ u
    both = left @ left + np.sum(one.data.imag**2) + np.sum(other.data.imag**2)
    assert left_on(other, fit) == pytest.approx(both - fit.cost, rel=1e-6)


@pytest.mark.parametrize("mass", [0.0, HEAVIER])
def test_a_mass_that_passed_for_a_gain_is_named_where_a_force_shows_it(mass):
    recording = problem(BY_CURRENT, mass)
    candidates = tuple(Candidate(fitted(recording, effects)) for effects in ((), ("mass",)))
    attribution = Attribution(0.0, candidates, 400.0, recording)
    named = [Entry(("mass",), 0.1, 0.0, 1, None)]
    shown = shown_by_both(problem(BY_FORCE, mass), attribution, named)
    assert [e.effects for e in shown] == ([("mass",)] if mass else [])
    assert shown_by_both(problem(BY_CURRENT, mass), attribution, named) == []  # which shows no more than before
    # Where the fitted recordings disagree, a difference of evidence counts less.
    assert shown_by_both(problem(BY_FORCE, mass), attribution, named, tempering=1e3) == []


@pytest.mark.parametrize("bent", [False, True])
def test_what_explains_a_part_of_the_holdout_alone_leaves_a_clear_gap_of_it(bent):
    """A mass that the force shows, with or without something that no mass does there."""
    recording = problem(BY_CURRENT, HEAVIER)
    candidates = tuple(Candidate(fitted(recording, effects)) for effects in ((), ("mass",)))
    attribution = Attribution(0.0, candidates, 400.0, recording)
    holdout = problem(BY_FORCE, HEAVIER)
    holdout.data = holdout.data + (5.0 * np.sin(np.arange(200.0)) if bent else 0.0)
    shown = shown_by_both(holdout, attribution, [Entry(("mass",), 0.1, 0.0, 1, None)])
    assert [e.effects for e in shown] == [("mass",)]
    assert leaves_clear_gap(holdout, attribution, shown) == bent
    assert calibration_fails(holdout, attribution) == bent
    assert not calibration_fails(problem(BY_CURRENT, HEAVIER), attribution)


def test_what_fitted_recordings_hardly_show_and_the_holdout_does_not_is_spoken_against():
    """A mass of 3 % to within 0.4 %, where 0.5 % is stated. A force that tells it well finds it there, or as stated."""
    recording = problem(23.0 * BY_FORCE / 1e3, 0.03)
    candidates = tuple(Candidate(fitted(recording, effects)) for effects in ((), ("mass",)))
    attribution, named = Attribution(0.0, candidates, 400.0, recording), [Entry(("mass",), 0.8, 0.0, 1, None)]
    assert 12.0 < candidates[0].predictive - candidates[1].predictive < 42.0
    assert spoken_against(problem(BY_FORCE, 0.0), attribution, named) == named
    assert spoken_against(problem(BY_FORCE, 0.03), attribution, named) == []
    # What the fitted recordings show plainly is not asked of the holdout here.
    plain = problem(BY_FORCE, 0.06)
    sure = Attribution(0.0, tuple(Candidate(fitted(plain, e)) for e in ((), ("mass",))), 400.0, plain)
    assert spoken_against(problem(BY_FORCE, 0.0), sure, named) == []


def named_by_force():
    """A mass of 1 % that the recordings to fit tell, as what is named."""
    recording, stated = problem(BY_FORCE, 0.01), {"actuator_gain": 0.02}
    candidates = tuple(Candidate(fitted(recording, effects, stated)) for effects in ((), ("mass",)))
    return Attribution(0.0, candidates, 400.0, recording), [Entry(("mass",), 0.8, 0.0, 1, None)]


def bent_holdout(bent):
    holdout = problem(BY_FORCE, 0.01)
    holdout.data = holdout.data + bent * np.sin(np.arange(200.0))
    return holdout


@pytest.mark.parametrize(
    ("bent", "form_share", "too_much"),
    [(0.0, 0.0, False), (2.0, 0.0, False), (3.5, 0.0, True), (3.5, 0.1, False), (8.0, 0.1, True)],
)
def test_a_name_that_leaves_much_of_the_gap_of_a_holdout_is_not_the_cause(monkeypatch, bent, form_share, too_much):
    """A mass that the fitted recordings tell, and something that grows on the holdout and is no mass."""
    attribution, named = named_by_force()
    monkeypatch.setattr(module, "_form_share", lambda *a: form_share)
    holdout = bent_holdout(bent)
    assert leaves_too_much(holdout, attribution, named) == (named if too_much else [])
    tones = [Entry(("pickup",), 0.8, 0.0, None, None), Entry(("calibration",), 0.2, 0.0, 0, None)]
    assert leaves_too_much(holdout, attribution, tones) == []


@pytest.mark.parametrize("louder", [1.0, 1.5])
def test_noise_that_is_widened_for_errors_at_single_moments_does_not_hide_what_a_name_leaves(louder):
    attribution, named = named_by_force()
    looks = bent_holdout(3.5)
    widened = SimpleNamespace(data=looks.data / 2, simulate=lambda p: looks.simulate(p) / 2, louder=louder)
    widened.again = lambda near: looks
    assert leaves_too_much(widened, attribution, named) == (named if louder > 1 else [])


def test_what_a_straight_line_from_the_fit_does_not_reach_is_fitted_before_a_name_is_dropped():
    """A holdout that grows with the cube of a mass: the fitted recordings tell it to within 0.3 %."""
    recording, truth, stated = problem(BY_FORCE / 35.0, 0.01), 0.04, {"actuator_gain": 0.02}

    def cubed(points):
        masses = np.array([p.effects.get("mass", {}).get("change", 0.0) for p in points])
        return 1.4e5 * np.outer(masses**3, np.linspace(0.5, 1.0, 200)) + 0j

    holdout = SimpleNamespace(
        data=1.4e5 * truth**3 * np.linspace(0.5, 1.0, 200) + noise(200), simulate=cubed, louder=1.0
    )
    candidates = tuple(Candidate(fitted(recording, effects, stated)) for effects in ((), ("mass",)))
    attribution = Attribution(0.0, candidates, 400.0, recording)
    assert left_on(holdout, candidates[1].fit) > 700.0
    assert leaves_too_much(holdout, attribution, [Entry(("mass",), 0.8, 0.0, 1, None)]) == []


def test_of_two_effects_the_one_that_explains_counts_with_its_form():
    fits = {"cubic_spring": 1000.0, "amplifier_voltage_limit": 110.0}  # without the other one

    def without(candidate, name):
        return fits[next(other for other in fits if other != name)]

    both = SimpleNamespace(effects=tuple(fits), fit=SimpleNamespace(cost=100.0))
    attribution = SimpleNamespace(candidates=[None, both], without=without)
    spring, limit = (module.EFFECTS[name].form_share for name in fits)
    found = module._form_share(attribution, 1)
    assert found == pytest.approx((10.0 * spring + 900.0 * limit) / 910.0)
    attribution.without = lambda candidate, name: np.inf
    assert module._form_share(attribution, 1) == max(spring, limit)
