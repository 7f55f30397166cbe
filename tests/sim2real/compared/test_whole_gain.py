"""A gain that is changed by a share multiplies the current that pulls, whatever gain and form there are already."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.experiment import Experiment
from maglev_env.lane_values import shaped_law
from maglev_env.loop.gains import Gains
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real.blind.benchmark.rigs import draw_rig
from sim2real.compared.point import NOMINAL, Point, experiment_at
from sim2real.compared.whole_gain import GAIN, with_more_gain

WITHIN = Point({}, {GAIN: 0.03})
RIGS = {
    "pair": load_rig("hmb_free"),
    "single": rig_from_toml(draw_rig("ball", np.random.default_rng(3)).toml(), "rig.toml"),
}


def pull(e, y, current):
    """What the magnets of an experiment pull with at a current of the coil (N)."""
    pulling = (1 + e.effects.get(GAIN, {}).get("change", 0.0)) * current
    return force(shaped_law(force_law(e.rig), e.effects), y, pulling)


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize(
    ("own", "point"),
    [
        ({}, NOMINAL),
        ({}, WITHIN),
        ({}, Point({}, {GAIN: -0.03})),
        ({"change": 0.1}, NOMINAL),
        ({"change": 0.1}, WITHIN),
        ({"change": 0.1}, Point({GAIN: {"change": -0.2}}, {GAIN: 0.03})),
        ({"change": 0.1, "force_share": 0.6}, WITHIN),
        ({}, Point({GAIN: {"change": 0.4, "force_share": 1.0}}, {})),
        ({}, Point({GAIN: {"change": -0.4, "force_share": 1.0}}, {})),
        ({}, Point({GAIN: {"change": 9.0}}, {})),
        ({}, Point({GAIN: {"change": -0.9, "force_share": 0.5}}, {})),
    ],
)
def test_a_larger_gain_pulls_as_a_larger_current_does(name, own, point):
    rig = replace(RIGS[name], effects={GAIN: own} if own else {})
    e = Experiment(rig, Gains(kp=1e4, ki=0.0, kd=10.0), ())
    stronger, share = with_more_gain(e, point, 0.01)
    assert abs(share) == pytest.approx(0.01)
    here, there = experiment_at(e, point), experiment_at(e, stronger)
    y, current = 0.1 * rig.gap, 0.2 * (rig.bias_current or 1.0)
    before, after = (pull(x, y, current) for x in (here, there))
    assert after != pytest.approx(before, rel=1e-5)
    assert after == pytest.approx(pull(here, y, (1 + share) * current), rel=1e-9)
