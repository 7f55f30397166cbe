"""The controller that stands in for an unknown one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.loop.gains import LinearController
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig_file import load_rig
from sim2real.recorded.drive.drive import drive_of
from sim2real.recorded.drive.stand_in import HOLDING, STIFF, holds, stand_in


@pytest.mark.parametrize("pole", [0.0, 0.5])
def test_a_fitted_controller_must_be_clearly_stiffer_at_rest_than_the_magnets(pole):
    rig = load_rig("hmb_free")
    gain, stiffness = linearise(force_law(rig))
    for share in (0.5, 1.05, 1.4, 1.6, 5.0):
        at_rest = share * abs(stiffness) / gain
        c = LinearController((at_rest * (1 - pole),), (1.0, -pole))
        assert holds(rig, c) == (share > HOLDING)
    assert holds(rig, LinearController((1.0,), (1.0, -1.0)))  # an integrator


def test_the_designed_stand_in_is_soft_where_the_reading_is_noisy_and_stiff_where_the_motion_is_large():
    rig = load_rig("hmb_free")
    gain, stiffness = linearise(force_law(rig))
    rng, t = np.random.default_rng(1), np.arange(4000)
    found = []
    for noise, motion in ((2e-6, 0.0), (1e-9, 0.1 * rig.gap)):
        y = noise * rng.normal(size=t.size) + motion * np.sin(2 * np.pi * t / 2000)
        gains, name = stand_in(rig, 1, np.zeros(t.size), np.zeros(t.size), y, fitted=False)
        assert "designed" in name
        found.append(gains.kp * gain / abs(stiffness) - 1)  # net stiffness in that of the magnets
    assert found == pytest.approx([min(STIFF), max(STIFF)], rel=0.05)


def test_nothing_is_held_over_the_samples_of_a_log_that_is_slower_than_the_controller():
    rig = replace(load_rig("hmb_free"), control_rate=1000.0)
    rng = np.random.default_rng(1)
    channels = {"displacement": 1e-6 * rng.normal(size=(1, 500)), "current": 0.1 * rng.normal(size=(1, 500))}
    for rate, held in ((1000.0, True), (200.0, False)):
        spec = SimpleNamespace(
            sample_rate=rate, gains=None, speed_rpm=0.0, intersample="zoh", excitations=(), channels={}
        )
        assert drive_of(rig, spec, channels).held is held
