"""The rig is found from its responses, steps stay where the margins surely allow, and the loop ends near the best."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from gain_sets import DELAY, PRESET, RIG, TRUTH, gain_set, true_rig

from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import loop_response
from maglev_env.loop.controller_forms import Pid, StateFeedback
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import controller_response, with_gains
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.task import make_task
from maglev_workbench.commands.tune.next_recording import summary
from sim2real.advice.proposal import Proposal
from tuning.campaign import steps as module
from tuning.campaign.candidates import Value
from tuning.campaign.carried import carried
from tuning.campaign.disagreement import Disagreement, diagnosing
from tuning.campaign.gain_set import GainSet, Response, pooled
from tuning.campaign.model import RIGS, SEEN, figure, large, model_of
from tuning.campaign.next_step import next_step, tuning_task
from tuning.campaign.recorded_sets import recorded_sets
from tuning.campaign.rig_fit import IdentifiedRig, fit_rig, measured_sensitivity
from tuning.lockstep import optima, rescored
from tuning.study.study import experiments


def failed(gains, name="down.npz"):
    return GainSet(gains, (name,), None, None, None, (), np.nan, np.nan, "touchdown: the displacement reaches 99%")


def test_responses_are_pooled_by_their_variances():
    one = Response(np.array([1.0, 2.0]), np.array([1 + 1j, 2.0]), np.array([1.0, 4.0]))
    other = Response(np.array([2.0, 3.0]), np.array([5.0, 1j]), np.array([1.0, 9.0]))
    both = pooled([one, other])
    np.testing.assert_allclose(both.frequency, [1, 2, 3])
    np.testing.assert_allclose(both.value, [1 + 1j, (2 / 4 + 5 / 1) / (1 / 4 + 1), 1j])
    np.testing.assert_allclose(both.variance, [1, 1 / (1 / 4 + 1), 9])
    assert pooled([]) is None


def test_the_measured_plant_tells_the_sensitivity_at_other_gains():
    rig, other = true_rig(), with_gains(PRESET, kp=11000.0, kd=7.0)
    f = np.geomspace(5, 2000, 40)
    plant = loop_response(protocol_experiment(rig, PRESET), f).plant
    rng = np.random.default_rng(0)
    sd = 0.01 * np.abs(plant)
    found, variance = measured_sensitivity(plant, sd**2, f, other, rig.control_rate)
    np.testing.assert_allclose(found, loop_response(protocol_experiment(rig, other), f).sensitivity, rtol=1e-9)
    drawn = plant + sd / np.sqrt(2) * (rng.standard_normal((4000, f.size, 2)) @ [1, 1j])
    spread = measured_sensitivity(drawn, sd**2, f, other, rig.control_rate)[0].var(axis=0)
    np.testing.assert_allclose(variance, spread, rtol=0.12)


def test_parameters_and_delay_are_found():
    rig = true_rig()
    sets = [gain_set(rig), gain_set(rig, with_gains(PRESET, kp=10000.0, kd=6.0), seed=1)]
    told = fit_rig(RIG, sets).told()
    for name, factor in TRUTH.items():
        assert told[name][0] == pytest.approx(factor * getattr(RIG, name), abs=4 * told[name][1])
        assert told[name][1] < (0.1 if name == "amplifier_time_constant" else 0.03) * abs(told[name][0])
    assert told["delay"][0] == pytest.approx(DELAY, abs=4 * told["delay"][1]) and told["delay"][1] < 0.3 * DELAY
    assert "probe_gain" not in told  # a converter's resolution does not show in a response


@pytest.mark.slow
def test_a_pid_of_another_form_is_tuned_in_its_own_gains():
    """With a pure integral, which here is slow, the steps are those of plain gains."""
    form = Pid(kp=9000.0, ki=1000.0, kd=7.5, td=1e-4)
    plain = with_gains(PRESET, kp=9000.0, ki=0.0, kd=7.5, td=1e-4)
    rig, steps = true_rig(), []
    for own in (form, plain):
        steps.append(next_step(replace(RIG, gains=own), [gain_set(rig, own)], goal="engineer"))
    assert [s.kind for s in steps] == ["climb", "climb"] and isinstance(steps[0].next, Pid)
    assert steps[0].next.kp == pytest.approx(steps[1].next.kp, rel=0.2)
    other = replace(RIG, gains=StateFeedback(9000.0, 7.5))
    with pytest.raises(ValueError, match="tuned in PID gains"):
        tuning_task(other, [], ("kp",))


def test_a_second_lag_is_told_from_that_of_the_amplifier():
    """Seen on a rig of another simulator: fitted with one lag and a delay alone, it looked 2.4 % heavier than it is."""
    rig = true_rig(**effect("sensor_lag", 8e-5))
    found = fit_rig(RIG, [gain_set(rig, noise=1e-3)])
    told = found.told()
    assert told["sensor_lag"][0] == pytest.approx(8e-5, abs=3 * told["sensor_lag"][1])
    assert told["sensor_lag"][1] < 2e-5 and abs(told["mass"][0] / rig.mass - 1) < 0.015


def test_draws_stay_inside_their_bounds_along_the_covariance():
    """A delay that cannot be negative takes its lag along, so that their sum stays what the recordings tell."""
    rig = RIG
    names = ("mass", "sensor_lag", "delay")
    covariance = np.array([[1e-4, 0, 0], [0, 0.25, -0.249], [0, -0.249, 0.25]])
    found = IdentifiedRig(rig, names, np.array([0.0, 2.0, 0.0]), covariance, 0.0, 1.0)
    drawn = found.drawn(2000, np.random.default_rng(0))
    assert drawn[:, 2].min() == 0.0 and (drawn[:, 2] == 0).mean() == pytest.approx(0.5, abs=0.05)
    assert (drawn[:, 1] + drawn[:, 2]).std() < 0.05 and drawn[:, 1].std() > 0.25


def test_the_gain_may_fall_by_what_the_loop_has_at_rest():
    """L(0) = (kp + ki) k_i / |k| where the integral leaks, however high the lowest line is."""
    held = gain_set(RIG, noise=1e-4)
    found = carried(fit_rig(RIG, [held]), [held], 0)
    exact = (PRESET.kp + PRESET.ki) * RIG.actuator_gain / abs(RIG.negative_stiffness)
    falls = found.falls(PRESET)
    assert falls[0] == pytest.approx(exact, rel=0.01) and 0.005 < np.std(falls) / exact < 0.03


@pytest.mark.slow
def test_intervals_of_parameters_hold_the_truth():
    """Noise far above the model error that intervals allow for, so that they are those of the noise."""
    rig, inside = true_rig(), []
    for seed in range(12):
        told = fit_rig(RIG, [gain_set(rig, noise=0.08, seed=seed)]).told()
        for name, factor in (*TRUTH.items(), ("delay", None)):
            value, se, nominal = told[name]
            inside.append(abs(value - (factor * nominal if factor else DELAY)) < 1.96 * se)
    assert np.mean(inside) > 0.85


def test_tuning_starts_at_the_preset_and_ends_when_that_does_not_hold():
    begun = next_step(RIG, [])
    assert begun.next == PRESET and begun.stop is None and begun.identified is None
    ended = next_step(RIG, [failed(PRESET)])
    assert ended.next is None and ended.keep is None and "diagnose" in ended.stop and "touchdown" in ended.notes[0]
    again = next_step(RIG, [failed(with_gains(PRESET, kp=20000.0))])
    assert again.next == PRESET


def test_bad_input_is_refused():
    with pytest.raises(ValueError, match="two axes"):
        next_step(load_rig("hmb_radial"), [])
    with pytest.raises(ValueError, match="no controlled magnet"):
        next_step(load_rig("pedestal"), [])
    other = failed(with_gains(PRESET, ti=2e-2), "run2.npz")
    with pytest.raises(ValueError, match=r"recorded at ti = .*--tune ti"):
        next_step(RIG, [failed(PRESET), other])


def peak_of(rig, gains):
    f = np.geomspace(1, 5000, 3000)
    return np.abs(loop_response(protocol_experiment(rig, gains), f).sensitivity).max()


def resonant():
    """A rig that mass, gains and lags do not describe: a second body swings on the first."""
    return true_rig(**effect("support_resonance", 150.0, damping_ratio=0.03, mass_ratio=0.2))


@pytest.mark.slow
def test_the_diagnosis_decides_what_is_recorded_where_model_and_recordings_disagree():
    said = Disagreement("no effect explains it.", None, (asked({"amplitude": 2.0}),))
    calls = []
    one = gain_set(resonant())
    advice = next_step(RIG, [one], diagnosis=lambda: calls.append(1) or said)
    assert advice.identified.contradicted and calls == [1] and advice.kind == "diagnose" and advice.stop is None
    assert advice.next == PRESET and "amplitude" in advice.why and "no effect explains it" in advice.notes[0]
    assert [e.amplitude for e in advice.excitations] == [2 * e.amplitude for e in RIG.protocol.excitations]
    # Once it is recorded, tuning goes on.
    again = next_step(RIG, [replace(one, files=("run1.npz", "run2.npz"))], diagnosis=lambda: said)
    assert again.kind != "diagnose"
    sound = next_step(RIG, [gain_set(true_rig())], diagnosis=lambda: pytest.fail("nothing to diagnose"))
    assert sound.kind == "climb"


@pytest.mark.slow
def test_a_rig_that_is_none_of_the_model_is_tuned_by_what_was_measured():
    advice = next_step(RIG, [gain_set(resonant())])
    assert advice.identified.contradicted and "maglev diagnose" in advice.notes[0]
    assert advice.claimed[0].peak.value == pytest.approx(peak_of(resonant(), PRESET), rel=0.03)
    # The sharp line of the body lies between the excited ones.
    assert advice.prediction.peak.value == pytest.approx(peak_of(resonant(), advice.next), rel=0.1)
    assert peak_of(resonant(), advice.next) < 0.8 * peak_of(resonant(), PRESET)


@pytest.mark.slow
def test_the_stated_mass_is_used_and_one_that_is_not_as_stated_is_no_reason_for_another_score():
    """A rotor that looks 12 % heavier is said to be so, and not judged by a mass outside of its tolerance."""
    heavy = replace(true_rig(), mass=1.12 * RIG.mass)
    found = fit_rig(RIG, [gain_set(heavy)])
    assert found.other_mass and abs(found.theta[0]) < 3.001 * np.hypot(0.005, 0.02) and found.names[0] == "mass"
    assert not fit_rig(RIG, [gain_set(true_rig())]).other_mass
    advice = next_step(RIG, [gain_set(heavy)])
    assert any("weigh the rotor" in note for note in advice.notes)
    # Of 1 / receptance = k - m w^2 the stiffness by the stated mass, not by the fitted one.
    seen = advice.shown[0].stiffness
    assert advice.claimed[0].values["stiffness"].value == pytest.approx(seen, rel=0.02)


@pytest.mark.slow
def test_a_goal_is_taken_from_the_rig_or_given():
    asked = "peak_sensitivity <= 2.2, phase_margin >= 28, compliance <= 60e-6, best noise_current near 0.02"
    sets = [gain_set(true_rig())]
    given = next_step(RIG, sets, goal=asked)
    own = next_step(replace(RIG, target=replace(RIG.target, goal=asked)), sets, budget=1)
    assert own.claimed[0].expected == given.claimed[0].expected and given.kind == "climb"
    assert set(given.claimed[0].missed) == {"peak_sensitivity", "phase_margin", "compliance"}
    promised = given.prediction
    assert not promised.missed and promised.values["noise_current"].value > 0
    loop = loop_response(protocol_experiment(true_rig(), given.next), np.geomspace(5, 240, 400))
    low, high = promised.values["compliance"].low, promised.values["compliance"].high
    assert 0.98 * low < np.abs(loop.receptance).max() < 1.02 * high
    assert peak_of(true_rig(), given.next) < 2.25
    match = first_step()
    assert match.task.layout.goal is None and match.claimed[0].met is None


UNMET = "compliance <= 1e-6, peak_sensitivity <= 4, worst of 4 rigs"


@cache
def unmet():
    """After one recording, of a goal that no gains meet."""
    return next_step(RIG, [gain_set(RIG)], goal=UNMET, budget=1)


@cache
def first_step():
    """After one recording of the true rig."""
    return next_step(RIG, [gain_set(true_rig())])


def test_a_requirement_that_cannot_be_met_is_named_where_it_stops():
    stopped = unmet()
    assert stopped.keep == 0 and stopped.claimed[0].missed == ("compliance",)
    assert "not met: worst compliance at most 1" in stopped.stop
    assert "worst of 4 rigs" in stopped.notes[0] and "rigs" not in stopped.task.rig.target.goal


def test_events_far_beyond_what_was_recorded_are_said_to_be():
    """Of a hidden rig that saturates at 0.4 A a lift-off of 2.5 ms was claimed, by recordings of 0.2 A; it took 6.5."""
    sets = [gain_set(RIG)]
    goal = "peak_sensitivity <= 4, lift_off_time <= 0.03 from 175e-6"
    stopped = next_step(RIG, sets, goal=goal, budget=1)
    assert stopped.keep == 0 and "lift-off is simulated" in stopped.notes[-1] and "0.15 A" in stopped.notes[-1]
    assert stopped.claimed[0].simulated == ("lift_off_time",)
    assert "that the recordings show is met; lift_off_time in simulation only" in summary(stopped)
    peak = float(stopped.notes[-1].split("up to ")[1].split(" A")[0])
    # The controller sees the rotor at rest 175 um away, and switches on.
    assert peak == pytest.approx(PRESET.kp * 175e-6, rel=0.3)
    near = goal.replace("175e-6", "5e-6")
    assert not next_step(RIG, sets, goal=near, budget=1).notes


def test_it_goes_on_where_a_missed_requirement_may_well_be_met():
    """Seen on a drawn rig: the best set missed 30 degrees in 80 % of the draws, gains that met everything in 72 % were
    not tried, because near a limit a score scatters by more than the gain of its mean."""
    advice = unmet()
    other = with_gains(PRESET, kp=9000.0)

    def worth(met, expected, known):
        own = replace(advice.claimed[0], met=known, expected=0.71, spread=0.03, reason=None)
        better = replace(advice.claimed[0], gains=other, met=met, expected=expected, spread=0.25)
        model = SimpleNamespace(point=lambda g: np.array([g.kp / 1e4]))
        return module._worth(replace(advice, claimed=(own,)), model, 0, better)

    assert worth(0.72, 0.73, 0.20) and not worth(0.72, 0.69, 0.20)
    assert not worth(0.30, 0.73, 0.20) and not worth(None, 0.73, None)


def test_far_from_a_limit_it_goes_on_by_factors():
    """Seen on two balls of another simulator: gains that miss three limits score 0.001, one step reaches 0.005 at most,
    and tuning stopped after its first recording."""
    advice = unmet()

    def worth(known, expected, spread):
        own = replace(advice.claimed[0], met=0.0, expected=known, spread=min(0.1 * known, 0.002), reason=None)
        better = replace(own, gains=with_gains(PRESET, kp=9000.0), expected=expected, spread=spread)
        model = SimpleNamespace(point=lambda g: np.array([g.kp / 1e4]))
        return module._worth(replace(advice, claimed=(own,)), model, 0, better)

    assert worth(0.001, 0.005, 0.001) and not worth(0.001, 0.0012, 0.0001)
    assert not worth(0.001, 0.005, 0.02)  # within what is not known
    assert not worth(0.5, 0.505, 0.001) and worth(0.5, 0.52, 0.001)


def test_a_goal_out_of_reach_is_said_to_be():
    """Seen on two pairs of another simulator: phase margin and compliance exclude each other within the ranges."""
    advice = next_step(RIG, [gain_set(RIG)], goal="compliance <= 1e-7, best compliance", budget=1)
    assert advice.claimed[0].missed == ("compliance",)
    task, corners = tuning_task(RIG, advice.sets, ("kp", "ki", "kd"), "compliance <= 1e-7, best compliance")
    responses = carried(advice.identified, advice.sets, 0)
    model = model_of(task, corners, advice.identified, responses, advice.sets, 0)
    inside = model.point(with_gains(PRESET, kp=9000.0))
    words = module._out_of_reach(advice, model, 0, inside)
    assert "miss compliance, too" in words and "range" not in words
    at_end = np.array([corners[1, 0], *inside[1:]])
    assert "with kp at the end of its range" in module._out_of_reach(advice, model, 0, at_end)
    met = replace(advice, claimed=(replace(advice.claimed[0], missed=()),))
    assert module._out_of_reach(met, model, 0, at_end) == ""


def test_it_goes_less_of_the_way_where_the_whole_is_not_sure(monkeypatch):
    """Seen on a drawn platform: of 12 rigs that the recordings allowed, 4 touched down at the search's best gains after
    an impulse, and tuning stopped at a compliance of 38 um/N; a step of 0.85 of the way has 23, on all of them."""
    recorded = unmet()
    own = replace(recorded.claimed[0], score=Value(0.85, 0.84, 0.86), expected=0.85, spread=0.002, met=1.0)
    advice = replace(recorded, claimed=(replace(own, reason=None),), stop=None)

    def tried(advice, model, anchor, point):
        whole = point[0] > 0.99
        score = Value(0.89, 0.01 if whole else 0.88, 0.9)
        better = replace(own, gains=with_gains(PRESET, kp=8000.0 * (1 + point[0])), score=score)
        return replace(better, expected=0.6 if whole else 0.88, met=0.67 if whole else 1.0), None

    model = SimpleNamespace(corners=np.array([[-1.0], [1.0]]), point=lambda g: np.array([g.kp / 8000.0 - 1]))
    monkeypatch.setattr(module, "optimum", lambda *_: np.array([1.0]))
    monkeypatch.setattr(module, "_tried", tried)
    monkeypatch.setattr(module, "_limit", lambda *_: 3.0)
    monkeypatch.setattr(module, "nearby", lambda *_: np.zeros((0, 1)))
    found = module.onward(advice, model, 0, 6)
    assert found.kind == "climb" and found.share == 0.85 and "not sure enough" in found.limited


def test_a_safe_step_is_made_to_learn_whether_what_is_promised_is_so(monkeypatch):
    """Seen on balls of another simulator: a first recording tells the gain margin to 10 %, so the search kept far from
    its limit, and tuning for little noise stopped there, with 1.41 mA where 0.99 met everything."""
    recorded = unmet()
    own = replace(recorded.claimed[0], score=Value(0.82, 0.81, 0.83), expected=0.82, spread=0.006, met=1.0, reason=None)
    advice = replace(recorded, claimed=(own,), stop=None)

    def tried(advice, model, anchor, point):
        gained = 0.04 * point[0]
        better = replace(
            own, gains=with_gains(PRESET, kp=8000.0 * (1 + point[0])), score=Value(0.82 + gained, 0.8, 0.87)
        )
        return replace(better, expected=0.82), "too near" if point[0] > 0.6 else None

    model = SimpleNamespace(
        corners=np.array([[-1.0], [1.0]]), point=lambda g: np.array([g.kp / 8000.0 - 1]), gains=lambda point: point[0]
    )
    monkeypatch.setattr(module, "optimum", lambda *_, draws=8: np.array([1.0 if draws == 1 else 0.0]))
    monkeypatch.setattr(module, "predict", lambda model, far: replace(own, score=Value(0.82 + 0.04 * far, 0.8, 0.9)))
    monkeypatch.setattr(module, "_tried", tried)
    monkeypatch.setattr(module, "_limit", lambda *_: 3.0)
    monkeypatch.setattr(module, "nearby", lambda *_: np.zeros((0, 1)))
    found = module.onward(advice, model, 0, 6)
    assert found.kind == "climb" and found.share == 0.55 and "the 0.860 are" in found.why
    monkeypatch.setattr(module, "predict", lambda model, far: replace(own, missed=()))  # nothing to hope for
    assert module.onward(advice, model, 0, 6).stop


def test_rigs_that_the_recordings_allow_agree_with_what_was_recorded():
    """Each rig has its own ratio of measured to simulated; by that of the best one, the others scattered by 30 %."""
    held = replace(gain_set(true_rig()), noise_current=0.0131)
    task, corners = tuning_task(RIG, [held], ("kp", "ki", "kd"), "noise_current <= 0.03, best compliance near 2e-5")
    identified = fit_rig(task.rig, [held])
    loose = replace(identified, covariance=identified.covariance * 400)  # so that the rigs differ
    model = model_of(task, corners, loose, carried(loose, [held], 0), [held], 0)
    lanes = experiments(task, model.episodes, np.tile(model.point(held.gains), (RIGS, 1)), [0] * RIGS)
    alone = figure(lanes, "noise_current")
    found = large(model, lanes, np.arange(RIGS), None)["noise_current"]
    known = alone > 0
    assert (alone[known] / alone[0]).std() > 0.04
    assert np.abs(found[known] / 0.0131 - 1).max() < 4 * SEEN["noise_current"]
    # What a noisy meter leaves open is left open, at these gains and elsewhere.
    meter = replace(held, noise_error=0.2)
    model = model_of(task, corners, loose, carried(loose, [meter], 0), [meter], 0)
    for at in (meter, None):
        spread = np.log(large(model, lanes, np.zeros(200, int), at)["noise_current"]).std()
        assert 0.15 < spread < 0.25


def test_a_sharp_line_is_not_smoothed_away():
    """A line at which the plant is another one, as at a resonance, makes |S| 4 there, between calm neighbours."""
    held = gain_set(RIG, noise=0.3)
    identified = fit_rig(RIG, [held])
    assert carried(identified, [held], 0).sharp.size == 0
    i = int(np.argmin(abs(held.plant.frequency - 600.0)))
    z = np.exp(2j * np.pi * held.plant.frequency / RIG.control_rate)
    c = controller_response(PRESET, z, 1 / RIG.control_rate)[i]
    value, variance = held.plant.value.copy(), held.plant.variance
    value[i] = (1 / 4.0 - 1) / c
    found = carried(identified, [replace(held, plant=Response(held.plant.frequency, value, variance))], 0)
    assert found.sharp.tolist() == pytest.approx([held.plant.frequency[i]])
    at = int(np.argmin(abs(found.injected - held.plant.frequency[i])))
    assert np.abs(found.sensitivity(PRESET)[0, at]) == pytest.approx(4.0, rel=1e-6)


def test_a_resonance_that_only_force_lines_show_is_in_the_sensitivity():
    """A second body whose mode of 605 Hz, 6 Hz wide, stands between the injection lines of 600 and 670 Hz."""
    force, current = RIG.protocol.excitations
    lines = (*force.lines, *(k for k in range(115, 130) if k not in current.lines))  # of 5 Hz
    dense = replace(RIG, protocol=replace(RIG.protocol, excitations=(replace(force, lines=lines), current)))
    body = effect("support_resonance", frequency=590.4, damping_ratio=0.005, mass_ratio=0.05)
    held = gain_set(replace(dense, effects=body), noise=0.02)
    found = carried(fit_rig(dense, [held]), [held], 0)
    i = int(np.argmin(abs(found.injected - 605.0)))
    assert found.injected[i] == pytest.approx(605.0) and 605.0 in np.round(found.sharp, 6)
    e = protocol_experiment(replace(dense, effects=body), PRESET)
    exact = np.abs(loop_response(e, found.injected[[i]]).sensitivity)
    assert np.abs(found.sensitivity(PRESET)[0, i]) == pytest.approx(float(exact[0]), rel=0.2)
    assert abs(exact[0] - 1.14) > 0.2  # what the loop has beside it


@pytest.mark.slow
def test_a_search_stays_off_the_limits_of_what_only_the_model_shows():
    """Events are known to 5 %: the best gains in a search reach a peak current some percent below its limit."""
    goal = (
        "peak_sensitivity <= 4, current_peak <= 0.8, impulse_displacement <= 2e-4 after 4e-3, best stiffness near 5e4"
    )
    advice = next_step(RIG, [gain_set(true_rig())], goal=goal)
    assert advice.kind == "climb" and advice.prediction.met > 0.95
    assert 0.6 < advice.prediction.values["current_peak"].value < 0.8 * 0.97


@pytest.mark.slow
def test_a_loop_with_thin_margins_is_calmed_first():
    """At these gains the phase margin is 15 degrees: they are not to be kept, and the next ones have more."""
    thin = with_gains(PRESET, kd=3.6)
    advice = next_step(RIG, [gain_set(true_rig(), thin)])
    assert advice.claimed[0].reason is not None and advice.stop is None and advice.kind in ("climb", "calm")
    assert peak_of(true_rig(), advice.next) < 0.9 * peak_of(true_rig(), thin)


@pytest.mark.slow
def test_a_step_is_safe_on_the_true_rig_and_what_it_promises_comes_true():
    rig, advice = true_rig(), first_step()
    peak = advice.prediction.peak
    true = peak_of(rig, advice.next)
    assert peak.low - 0.02 < true < peak.high + 0.02 and peak.high <= module.PEAK_SENSITIVITY
    assert advice.share == 1.0 and advice.stop is None
    for name, (least, most) in RIG.bounds.items():
        assert least <= getattr(advice.next, name) <= most
    budget = next_step(RIG, [gain_set(rig)], budget=1)
    assert "budget of 1" in budget.stop and (budget.keep is None) == bool(budget.claimed[0].reason)


@pytest.mark.slow
def test_a_failure_is_kept_away_from_and_noise_widens_what_is_claimed(monkeypatch):
    rig = true_rig()
    sure = gain_set(rig)
    full = first_step()
    point = full.task.box.actions([[getattr(g, n) for n in full.task.box.names] for g in (PRESET, full.next)])
    beside = next_step(RIG, [sure, failed(full.next)])
    assert beside.share <= 0.55 and "failed" in beside.limited
    if beside.next:
        tried = full.task.box.actions([getattr(beside.next, n) for n in full.task.box.names])
        assert np.linalg.norm(tried - point[0]) < np.linalg.norm(tried - point[1])
    noisy = next_step(RIG, [gain_set(rig, noise=0.3)])
    width = [a.claimed[0].peak.high - a.claimed[0].peak.low for a in (full, noisy)]
    assert width[1] > 3 * width[0]
    monkeypatch.setattr(module, "LOUDER", 1.02)
    small = next_step(RIG, [sure])
    assert small.share < 1 and "at once" in small.limited


def words(change):
    return f"a recording with {change}"


def asked(change):
    return Proposal(words(change), "it tells", 1.0, None, change)


@pytest.mark.slow
def test_a_rig_is_tuned_recording_by_recording(tmp_path):
    """Campaign folders as `maglev simulate` writes them, from a rig drawn wide, until it says stop."""
    task = make_task(RIG, randomization="wide")
    episode = task.draw(np.random.default_rng((1, 5)))
    rows, peaks, sets = [], [], []
    for _ in range(6):
        advice = next_step(RIG, sets, budget=6)
        if advice.stop:
            break
        e = protocol_experiment(episode.rig, advice.next, seed=len(rows))
        f = np.geomspace(1, 5000, 2000)
        peaks.append(np.abs(loop_response(Experiment(episode.rig, advice.next, ()), f).sensitivity).max())
        rows.append((f"run{len(rows) + 1}", "fit", simulated_recording(e, simulate_records([e])[0]), e))
        write_campaign(tmp_path, "hmb_free", {}, rows, overwrite=True)
        _, sets = recorded_sets(load_campaign(tmp_path))
    assert advice.stop and advice.keep is not None and len(rows) <= 5
    assert max(peaks[1:], default=0.0) < 3.2
    kept = task.box.actions([[getattr(sets[advice.keep].gains, n) for n in task.box.names]])
    _, best = optima(task, [episode], 0, 200)
    assert best[0] - rescored(task, [episode], kept, 1)[0] < 0.05


def test_a_diagnosing_recording_is_made_once_and_only_where_it_can_be_stated():
    one, protocol = [gain_set(true_rig())], RIG.protocol

    def stated(*changes, sets=one):
        return diagnosing(Disagreement("", None, tuple(map(asked, changes))), PRESET, protocol, sets)

    other = with_gains(PRESET, kp=1.2 * PRESET.kp, kd=1.5 * PRESET.kd)
    gains, shaken = {"gains": [1.2, 1.5]}, {"excitation": {"at": "force"}}
    assert stated(gains) == (words(gains), other, protocol.excitations)
    made = [*one, replace(one[0], gains=other)]
    assert stated(gains, sets=made) is None
    assert stated(shaken) == (words(shaken), PRESET, protocol.excitations)
    assert stated(gains, {"channels": ["current"]}, shaken, sets=made) == stated(shaken)  # the first that can be made
    assert stated({"offset": 1e-5}) is None and stated({}) is None
    assert stated({"amplitude": 2.0}, sets=[replace(one[0], files=("a", "b"))]) is None
