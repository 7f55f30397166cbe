"""What a recording without a period leaves open is asked of the recording that tells it best."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from bench_loop import Bench, write_campaign
from campaigns import campaign

from maglev_env.loop.magnets.kinds import geometric_law
from maglev_env.rig.rig import Noise
from sim2real.advice.recording_menu import Item, menu
from sim2real.advice.separation import differences, look, separation
from sim2real.compared.problem import assemble
from sim2real.recorded.opened import stated_noise
from sim2real.recorded.records import read_records
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis


@pytest.mark.slow
def test_the_separation_expected_of_a_repetition_is_the_one_that_was_found(tmp_path):
    """Of a bench with a delay, fitted as a delay and as less gain, which leaves what only the phase shows."""
    _, (record,) = read_records(write_campaign(tmp_path, Bench(delay=10e-6), {"noise": "fit"}, 1.0, 0))
    problem = assemble([record])
    right, wrong = Hypothesis(("delay",), {}), Hypothesis(("actuator_gain",), {})
    fits = begin([right, wrong], [np.array([0.1]), np.zeros(1)], problem.data, problem.simulate)
    iterate(fits, problem.data, problem.simulate, 10)
    differentiate(fits, problem.data, problem.simulate, True)
    found = fits[1].cost - fits[0].cost
    (part,), items = problem.parts, menu(record)
    outputs = part.opened.outputs
    assert [i.outputs for i in items] == [outputs] * len(items)
    expected, pair = separation([differences(Item("the same", 1.0, record, outputs, {}), part, fits)], fits)
    assert pair == tuple(fits)
    # A delay that were not there would be refitted to both recordings, which leaves half the cost; less gain would not.
    assert found > 30 and 0.45 * found < expected < 1.1 * found
    table = {tuple(i.change): separation([differences(i, part, fits)], fits)[0] for i in items}
    assert {"amplitude", "excitation", "offset", "gains"} == {name for (name,) in table}
    assert 1.3 * expected < table[("amplitude",)] < 4.1 * expected  # 4 without any refit
    assert all(np.isfinite(value) for value in table.values()) and table[("excitation",)] > expected


def stating(record, noise):
    """The record of the same rig that states a noise and ideal converters."""
    rig = replace(record.nominal, noise=noise, adc_bits=0, dac_bits=0)
    return replace(record, nominal=rig, experiment=replace(record.experiment, rig=rig))


@pytest.mark.parametrize("current", [True, False])
def test_a_recording_is_as_noisy_as_the_one_that_was_made_whatever_the_rig_states(tmp_path, current):
    """Only what that has not shown is as noisy as stated, and expected of nothing where no noise is."""
    keep = ("force", "injection", "displacement") + ("current",) * current
    _, (record, *_) = read_records(campaign(tmp_path, names=("base",), keep=keep))
    part, none = assemble([record]).parts[0], stating(record, Noise())
    noise = np.sqrt(stated_noise(record, replace(part.opened, outputs=("plant", "amplifier"))) / record.count)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        looks = [(item, look(item, part)[1]) for item in menu(none) if item.outputs]
    told = [row for item, weights in looks for row in zip(item.outputs, weights, noise, strict=False)]
    for output, own, expected in told:
        if output in part.opened.outputs:
            own = own[..., : expected.shape[-1]]  # one above the band has more lines
            assert np.median(own * expected) == pytest.approx(np.sqrt(2), rel=0.3)
        else:
            assert np.isinf(own).all()
    silent = [item for item, weights in looks if np.isinf(weights).any()]
    assert bool(silent) == (not current) and all(differences(item, part, []) is None for item in silent)


@pytest.mark.parametrize("most", [None, 1e-2])
def test_no_injection_needs_more_than_the_converter_can_command(tmp_path, most):
    """Of a voice coil the bias current is that of a magnet that is not there."""
    _, (record, *_) = read_records(campaign(tmp_path, names=("base",)))
    if most is not None:
        rig = replace(record.nominal, amplifier_gain=most / record.nominal.voltage_range)
        record = replace(record, nominal=rig, experiment=replace(record.experiment, rig=rig))
    above = [i.change["excitation"] for i in menu(record) if i.change.get("excitation", {}).get("at") == "current"]
    peaks = [
        excitation["peak"] for excitation in above if min(excitation["lines"]) > record.lines[record.excited].max()
    ]
    bias = geometric_law(record.nominal).bias_current
    assert peaks == [pytest.approx(0.2 * bias if most is None else 0.3 * most)]


@pytest.mark.slow
def test_a_measured_force_tells_a_late_reading_from_a_late_force_which_no_current_does(tmp_path):
    """Of a first-order lag of 50 us."""
    _, (record,) = read_records(write_campaign(tmp_path, Bench(), {"noise": "fit"}, 1.0, 0))
    problem = assemble([record])
    reading, force = Hypothesis(("sensor_lag",), {}), Hypothesis(("eddy_current",), {})
    starts = [np.full(1, 5.0), np.array([-np.log(1e-4 * np.pi), 10.0])]
    fits = begin([reading, force], starts, problem.data, problem.simulate)
    differentiate(fits, problem.data, problem.simulate, True)
    looks = [(i, differences(i, problem.parts[0], fits)) for i in menu(record)]
    table = [(i, separation([own], fits)[0]) for i, own in looks if own is not None]
    pushed = [value for i, value in table if i.change.get("excitation", {}).get("at") == "force"]
    others = [value for i, value in table if i.change.get("excitation", {}).get("at") != "force"]
    assert len(pushed) == 1 and pushed[0] > 100 > 10 * max(others)


@pytest.mark.parametrize("periodic", [True, False])
def test_one_excitation_lies_above_all_that_was_driven_and_is_compared_there(tmp_path, periodic):
    if periodic:
        _, (record, *_) = read_records(campaign(tmp_path, names=("base",)))
    else:
        _, (record,) = read_records(write_campaign(tmp_path, Bench(), {"chirp": "fit"}, 0.5, 0))
    part = assemble([record]).parts[0]
    (item,) = [i for i in menu(record) if i.record.lines.size > record.lines.size]
    asked = item.change["excitation"]
    at = asked.get("frequencies") or np.array(asked["lines"]) * record.experiment.fundamental
    assert min(at) > record.frequency[record.excited].max() and max(at) < 0.41 * record.nominal.control_rate
    weights = look(item, part)[1]
    assert weights.shape[-1] == item.record.lines.size and (weights[..., -1] > 0).all() and np.isfinite(weights).all()
    assert np.ptp(item.record.waves["current"] - record.waves["current"]) > 0


def test_a_coil_current_that_was_not_recorded_is_asked_for_beside_what_never_repeats(tmp_path):
    _, (record,) = read_records(write_campaign(tmp_path, Bench(), {"noise": "fit"}, 0.5, 0))
    silent = replace(record, series={"displacement": record.series["displacement"]})
    part = assemble([silent]).parts[0]
    item, above = (i for i in menu(silent) if "channels" in i.change)
    assert item.change == {"channels": ["current"]} and above.change["excitation"]["at"] == "current"
    assert look(above, part)[1].shape[0] == 2  # outputs
    assert not [i for i in menu(record) if "channels" in i.change] and part.opened.outputs == ("plant",)
    weights = look(item, part)[1]
    sd = 2 * record.nominal.noise.current / np.sqrt(record.windows.samples)
    assert weights[1] == pytest.approx(np.sqrt(2) / sd, rel=1e-6)
