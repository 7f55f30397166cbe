"""A gain that changes over the record: in noise there is none, and it is found in its block at its rate."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import planned, repeated

from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.free import trend as own
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
        ("free_current", effect("gain_drift", -0.02), -0.02),
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


@pytest.mark.parametrize("falls", [0, 1, 2, 3])
def test_a_gain_with_which_the_rotor_touches_down_in_any_recording_is_not_asked_for(monkeypatch, falls):
    """Two recordings are fitted and two judge; in one of them the rotor falls with a little more gain of the probe."""
    rng = np.random.default_rng(0)

    def row(i):
        reading, other, noise = rng.standard_normal((3, 50, 2)) @ (1, 1j)
        by = {"free_reading": 10 * reading, "free_current": 10 * reading + 3 * other}
        return own._Row(3 * reading + noise, {n: v for n, v in by.items() if (i, n) != (falls, "free_reading")})

    rows = [row(i) for i in range(4)]
    record = SimpleNamespace(count=8, experiment=SimpleNamespace(fundamental=4.0))
    parts = [SimpleNamespace(record=record, row=one) for one in rows]
    monkeypatch.setattr(own, "_row", lambda part, _: part.row)
    found = trend_of(SimpleNamespace(parts=parts[:2]), SimpleNamespace(parts=parts[2:]), NOMINAL, 0)
    assert found.place == "free_current"
    assert found.rate == pytest.approx(0.3 / 1.09, rel=0.1)  # along a row of 1.09 times the power
