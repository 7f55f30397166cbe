"""A gain of the actuator that differs between recordings, in simulations whose rig differs between them."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import planned, write

from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import tolerances
from sim2real.compared.problem import assemble
from sim2real.gap.between_recordings import gain_between
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
    told = gain_between(problem, fits[0])
    if found is None:
        assert told is None
    else:
        (change,) = told.change.values()
        assert change == pytest.approx(found, abs=0.004) and told.closes > 0.9
        assert "repeat the first recording" in told.in_words()
