"""Rigs that are written are read back as they were."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.loop.axes import Cross
from maglev_env.loop.controller_forms import Cascade, CurrentLoop, Pid
from maglev_env.loop.effect import effect
from maglev_env.loop.filtered_pid import FilteredPid, LeadLag, LowPass, Notch
from maglev_env.loop.gains import LinearController
from maglev_env.loop.self_sensor import SelfSensing
from maglev_env.rig.rig_file import PRESETS, load_rig, rig_from_toml
from maglev_env.rig.rig_toml import rig_toml

FREE = load_rig("hmb_free")
EVERYTHING = replace(
    load_rig("hmb_radial"),
    name='R "1"\\ \u00e9',
    per_axis={"y": {"mass": 0.9, "negative_stiffness": -1.1e4, "bearings": 1}},
    cross=Cross(3000.0, -2000.0, 1.5, 0.0, 0.8, -0.5, 0.1, -0.07),
    gains=(FREE.gains, replace(FREE.gains, kp=7e3)),
    randomization={"mass": (0.8, 1.25)},
    self_sensing=SelfSensing(kp=2.6e-3, ki=35.0, forward_path="analog", adc_bits=0),
    effects={**effect("saturation", np.inf), **effect("cross_coupling", 0.1)},
    target=replace(FREE.target, stiffness=3e4, band=(1 / 3, 70.0)),
)
LINEAR = replace(FREE, gains=LinearController((8000.0, -7000.0), (1.0, -0.3)), protocol=None, bounds={})
CASCADE = replace(FREE, gains=Cascade(Pid(900.0, ki=4e3, kd=1 / 30), CurrentLoop(12.0, 1 / 7), 4.0, (-2.0, 2.5)))
FILTERS = {"notch": Notch(650.0, 0.05), "notch2": Notch(901.5), "lead_lag": LeadLag(120.0), "low_pass": LowPass(3e3)}
FILTERED = replace(EVERYTHING, gains=(FilteredPid(8e3, 900.0, 12.7, **FILTERS), FilteredPid(7e3, 0.0, 9.0)))
WRITTEN = {"everything": EVERYTHING, "linear": LINEAR, "cascade": CASCADE, "filtered": FILTERED}


@pytest.mark.parametrize("rig", [*map(load_rig, PRESETS), *WRITTEN.values()], ids=[*PRESETS, *WRITTEN])
def test_any_rig_is_read_back_as_it_was_written(rig):
    text = rig_toml(rig)
    assert rig_from_toml(text, "here") == rig
    assert max(map(len, text.splitlines())) <= 120
