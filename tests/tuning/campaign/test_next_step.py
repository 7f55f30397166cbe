"""The rig is found from its responses, steps stay where the margins surely allow, and the loop ends near the best."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.design.defaults import with_defaults
from maglev_env.evaluation.evaluate import force_statistics
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import expected_statistics, loop_response
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import with_gains
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.drawn import scaled_rig
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import load_rig
from maglev_env.task.protocol import env_protocol
from maglev_env.task.task import make_task
from tuning.campaign import next_step as module
from tuning.campaign.next_step import next_step
from tuning.campaign.recorded_sets import GainSet, Response, pooled, recorded_sets
from tuning.campaign.rig_fit import fit_rig, measured_sensitivity
from tuning.lockstep import optima, rescored

LOADED = with_defaults(load_rig("hmb_free"))
RIG = replace(LOADED, protocol=env_protocol(LOADED, "quick"))
PRESET = RIG.gains
TRUTH = {"mass": 1.12, "actuator_gain": 0.85, "negative_stiffness": 1.2, "amplifier_time_constant": 1.1}
DELAY = 4e-5


def true_rig(**effects):
    return replace(scaled_rig(RIG, TRUTH), effects={**effect("delay", DELAY), **effects})


def gain_set(rig, gains=PRESET, noise=2e-3, seed=0, name="run1.npz"):
    """What a recording at gains shows, exactly but for relative noise on each line."""
    e, rng = protocol_experiment(rig, gains), np.random.default_rng(seed)
    force, injected = (lines_at(e.excitations, place) * e.fundamental for place in ("force", "current"))

    def curve(frequency, value):
        noisy = value * (1 + noise / np.sqrt(2) * (rng.standard_normal((2, value.size)).T @ [1, 1j]))
        return Response(frequency, noisy, (noise * np.abs(value)) ** 2)

    x = force / rig.control_rate
    shaken, loop = loop_response(e, force), loop_response(e, injected)
    statistics = force_statistics(expected_statistics(e, lines_at(e.excitations, "force")), e)
    return GainSet(
        gains, (name,), curve(force, shaken.receptance / (np.sinc(x) * np.exp(-1j * np.pi * x))),
        curve(injected, loop.sensitivity), curve(injected, loop.plant), (statistics,), 2e-5, 0.05, None,
    )  # fmt: skip


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
    other = failed(with_gains(PRESET, td=2e-4), "run2.npz")
    with pytest.raises(ValueError, match=r"recorded at td = .*--tune td"):
        next_step(RIG, [failed(PRESET), other])


def test_a_rig_that_is_none_of_the_model_stops_with_the_command_that_tells_why():
    rig = true_rig(**effect("sensor_resonance", 90.0, coupling=0.4))
    advice = next_step(RIG, [gain_set(rig)])
    assert advice.identified.contradicted and "maglev diagnose" in advice.stop and advice.next is None


@pytest.mark.slow
def test_a_step_is_safe_on_the_true_rig_and_what_it_promises_comes_true():
    rig = true_rig()
    advice = next_step(RIG, [gain_set(rig)])
    low, high = advice.prediction.peak
    f = np.geomspace(1, 5000, 3000)
    peak = np.abs(loop_response(protocol_experiment(rig, advice.next), f).sensitivity).max()
    assert low - 0.02 < peak < high + 0.02 and high <= module.PEAK_SENSITIVITY
    assert advice.share == 1.0 and advice.stop is None
    for name, (least, most) in RIG.bounds.items():
        assert least <= getattr(advice.next, name) <= most
    budget = next_step(RIG, [gain_set(rig)], budget=1)
    assert "budget of 1" in budget.stop and (budget.keep == 0) == (not budget.refused)


@pytest.mark.slow
def test_an_uncertain_plant_shortens_the_step_and_a_failure_is_kept_away_from(monkeypatch):
    rig = true_rig()
    sure = gain_set(rig)
    full = next_step(RIG, [sure])
    point = full.task.box.actions([[getattr(g, n) for n in full.task.box.names] for g in (PRESET, full.next)])
    beside = next_step(RIG, [sure, failed(full.next)])
    assert beside.share <= 0.55 and "failed" in beside.limited
    if beside.next:
        tried = full.task.box.actions([getattr(beside.next, n) for n in full.task.box.names])
        assert np.linalg.norm(tried - point[0]) < np.linalg.norm(tried - point[1])
    sound = gain_set(RIG)
    p = sound.plant
    doubtful = next_step(RIG, [replace(sound, plant=replace(p, variance=(0.4 * np.abs(p.value)) ** 2))])
    assert doubtful.prediction is None or doubtful.prediction.peak[1] <= module.PEAK_SENSITIVITY
    assert doubtful.share < 1 and ("peak sensitivity may reach" in doubtful.limited or "margin" in doubtful.limited)
    monkeypatch.setattr(module, "LOUDER", 1.02)
    small = next_step(RIG, [sure])
    assert small.share < 1 and "at once" in small.limited


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
        sets = recorded_sets(load_campaign(tmp_path))
    assert advice.stop and advice.keep is not None and len(rows) <= 5
    assert max(peaks[1:], default=0.0) < 3.2
    kept = task.box.actions([[getattr(sets[advice.keep].gains, n) for n in task.box.names]])
    _, best = optima(task, [episode], 0, 200)
    assert best[0] - rescored(task, [episode], kept, 1)[0] < 0.05
