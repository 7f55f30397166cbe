"""What a recording without a period leaves open is asked of the recording that tells it best."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from bench_loop import Bench, write_campaign
from campaigns import campaign

from maglev_env.rig.rig import Noise
from sim2real.advice.next_experiment import _look, _separation
from sim2real.advice.recording_menu import Item, menu
from sim2real.compared.problem import assemble
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
    expected = _separation(Item("the same", 1.0, record, outputs, {}), part, fits)
    # A delay that were not there would be refitted to both recordings, which leaves half the cost; less gain would not.
    assert found > 30 and 0.45 * found < expected < 1.1 * found
    table = {tuple(i.change): _separation(i, part, fits) for i in items}
    assert {"amplitude", "excitation", "offset", "gains"} == {name for (name,) in table}
    assert 1.3 * expected < table[("amplitude",)] < 4.1 * expected  # 4 without any refit
    assert all(np.isfinite(value) for value in table.values()) and table[("excitation",)] > expected


@pytest.mark.parametrize("states", [True, False])
def test_nothing_is_expected_of_a_designed_recording_where_no_noise_is_stated(tmp_path, states):
    folder = campaign(tmp_path, names=("base",))
    _, (record, *_) = read_records(folder)
    rig = record.nominal if states else replace(record.nominal, noise=Noise(), adc_bits=0, dac_bits=0)
    items = menu(replace(record, nominal=rig, experiment=replace(record.experiment, rig=rig)))
    part = assemble([record]).parts[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        looks = [_look(item, part)[1] for item in items if item.outputs]
    assert looks and all(np.isfinite(weights).all() == states for weights in looks)
    assert states or {_separation(item, part, []) for item in items if item.outputs} == {-np.inf}
