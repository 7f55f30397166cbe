"""The mean voltage of a coil against its mean current, on a record of a coil that is made by Ohm's law."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from maglev_env.loop.magnets.kinds import geometric_law
from maglev_env.recordings.campaign_tables import ChannelSource
from maglev_env.recordings.recording import _bias
from maglev_env.redundancy.resistance import ohm
from maglev_env.rig.rig import axis_rig
from maglev_env.rig.rig_file import load_rig

RIG = replace(load_rig("eframe"), coil_resistance=4.0, coil_inductance=0.03)
BIAS = geometric_law(RIG).bias_current


def found(shown=1.0, total=(True, True), switched=0.0, **changes):
    """The rule on 1000 samples of a coil that has `shown` times the stated resistance."""
    rng = np.random.default_rng(5)
    current = BIAS + 0.1 * BIAS * np.sin(np.arange(1000) / 20)
    voltage = shown * RIG.coil_resistance * current + switched * rng.choice([-1.0, 1.0], current.size)
    channels = {"current": current - BIAS, "voltage": voltage - BIAS * RIG.coil_resistance}
    sources = {n: ChannelSource((n,), (1.0,), total=t) for n, t in zip(("voltage", "current"), total, strict=True)}
    campaign: Any = SimpleNamespace(rig=replace(RIG, **changes))
    spec: Any = SimpleNamespace(file="run.csv", name="run.csv", channels=sources)
    return ohm(campaign, spec, channels)


def test_each_axis_has_its_own_resistance_and_bias():
    """A right coil of 8 ohm beside one of 4 had been "2 times coil_resistance"."""
    own = {"coil_resistance": 8.0, "coil_inductance": 0.06, "bias_current": 0.5}
    rig = replace(RIG, axes=2, per_axis={"y": own}, protocol=None, bias_current=0.3)
    biases = {axis: geometric_law(axis_rig(rig, i)).bias_current for i, axis in enumerate("xy")}
    assert biases == {"x": 0.3, "y": 0.5}
    swing = 0.05 * np.sin(np.arange(1000) / 20)
    channels = {f"current_{a}": swing for a in "xy"} | {"voltage_x": 4.0 * swing, "voltage_y": 8.0 * swing}
    spec: Any = SimpleNamespace(
        file="run.csv", name="run.csv", channels={n: ChannelSource((n,), (1.0,), total=True) for n in channels}
    )
    campaign: Any = SimpleNamespace(rig=rig)
    assert not ohm(campaign, spec, channels)
    (one,) = ohm(campaign, spec, channels | {"voltage_y": 8.0 * swing - 2.0})
    assert one.channel == "voltage_y or current_y" and "(8 ohm)" in one.message
    assert [_bias(campaign, Path("run.csv"), n) for n in ("current_x", "current_y", "voltage_y")] == [0.3, 0.5, 4.0]


@pytest.mark.parametrize("shown", [0.5, 2.0, -1.0])
def test_a_voltage_that_contradicts_the_resistance_is_said(shown):
    (one,) = found(shown)
    assert one.kind == "wiring" and one.value == pytest.approx(shown, rel=1e-2) and "coil_resistance" in one.message


def test_a_warm_coil_deviations_a_switched_voltage_and_a_wide_tolerance_say_nothing():
    assert not found() and not found(1.25)
    assert not found(0.5, (True, False)) and not found(0.5, (False, False))
    assert not found(0.5, switched=50.0 * BIAS * RIG.coil_resistance)
    assert not found(0.5, tolerance={"coil_resistance": 0.2})
    assert not found(0.5, coil_resistance=0.0)
