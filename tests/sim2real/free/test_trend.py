"""A gain that changes over the record: in noise there is none, and it is found in its block at its rate."""

from dataclasses import replace

import pytest
from campaigns import planned, repeated

from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.free.trend import trend_of

NOMINAL = Point({}, {})


def problems(folder, effects=None):
    """Two problems of two records each."""
    (plan,) = planned(load_rig("hmb_free"), names=("base",))
    e = replace(plan.experiment, periods=8, effects=effects or {})
    records = repeated(folder, [replace(e, seed=seed) for seed in range(4)])
    return assemble(records[:2]), assemble(records[2:])


@pytest.mark.slow
def test_in_noise_there_is_no_trend(tmp_path):
    assert trend_of(*problems(tmp_path), NOMINAL, 0) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "effects", "rate"),
    [
        ("free_current", effect("gain_drift", -0.05), -0.05),
        ("free_reading", effect("free_reading", 1.0, rate=0.02), 0.02),
    ],
)
def test_it_is_found_where_it_is(tmp_path, place, effects, rate):
    found = trend_of(*problems(tmp_path, effects), NOMINAL, 0)
    assert found.place == place
    assert found.rate == pytest.approx(rate, rel=0.15)
    assert found.closes > 0.5
    assert ("falls" if rate < 0 else "grows") in found.in_words()
    assert found.added_to(NOMINAL).effects[place]["rate"] == found.rate
