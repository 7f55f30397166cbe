"""A gain or a delay that differs between recordings, in simulations whose rig differs between them."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import planned, write

from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import tolerances
from sim2real.compared.problem import assemble
from sim2real.gap.between_recordings import between_recordings
from sim2real.recorded.records import read_records
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis

FREE = load_rig("hmb_free")


@pytest.mark.parametrize(
    ("first", "second", "found"),
    [
        (effect("actuator_gain", 0.01), effect("actuator_gain", -0.02), -0.03),
        (effect("actuator_gain", 0.02), effect("actuator_gain", 0.02), None),  # within the tolerance
        (effect("saturation", 0.45), effect("saturation", 0.45), None),
        ({}, effect("mass", 0.03), None),
    ],
)
def test_what_differs_between_recordings_is_told_from_what_acts_in_all(tmp_path, first, second, found):
    rows = [
        (p.name, "fit", replace(p.experiment, effects=one))
        for p, one in zip(planned(FREE, names=("base", "half")), (first, second), strict=True)
    ]
    problem = assemble(read_records(write(tmp_path, rows))[1])
    h = Hypothesis((), tolerances(FREE), scales=FREE.scales)
    fits = begin([h], [np.zeros(h.size)], problem.data, problem.simulate)
    iterate(fits, problem.data, problem.simulate, 25)
    told = between_recordings(problem, fits[0])
    if found is None:
        assert told is None
    else:
        (change,) = told.change.values()
        assert told.effect == "actuator_gain"
        assert change == pytest.approx(found, abs=0.004) and told.closes > 0.9
        assert "repeat the first recording" in told.in_words()


def test_a_delay_that_differs_between_recordings_is_told_with_its_changes(tmp_path):
    late = {"base": 1e-5, "half": 3e-5, "holdout": 1.8e-5}
    rows = [
        (p.name, "fit", replace(p.experiment, effects=effect("delay", late[p.name])))
        for p in planned(FREE, names=tuple(late))
    ]
    problem = assemble(read_records(write(tmp_path, rows))[1])
    alone, delayed = (Hypothesis(names, tolerances(FREE), scales=FREE.scales) for names in ((), ("delay",)))
    first = np.zeros(delayed.size)
    first[0] = delayed.coordinates[0].at(1e-5)
    fits = begin([alone, delayed], [np.zeros(alone.size), first], problem.data, problem.simulate)
    iterate(fits, problem.data, problem.simulate, 25)
    told = between_recordings(problem, *fits)
    assert told.effect == "delay" and told.closes > 0.9
    assert [*told.change.values()] == pytest.approx([2e-5, 8e-6], rel=0.2)  # to first order
    assert "half.npz about +" in told.in_words()
    assert between_recordings(problem, fits[0]) is None
