"""A command that is the injection, under whatever scale, is refused in a loop, and is right where nothing controls."""

import numpy as np
import pytest

from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.redundancy.alike import alike
from maglev_env.redundancy.view import View
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig

RIG = load_rig("hmb_free")
RNG = np.random.default_rng(1)
DRIVE = RNG.normal(size=5000)


def view(command, name="injection", rig=RIG, gains=RIG.gains):
    channels = {"displacement": 1e-5 * RNG.normal(size=DRIVE.size), "command": command, name: DRIVE}
    names = frozenset(channels)
    return View("run", RIG.control_rate, channels, names, {n: f"column {n}" for n in names},
                (Excitation("none", "current"),), frozenset(), gains, (), rig, RIG.mass)  # fmt: skip


@pytest.mark.parametrize("name", ["injection", "reference"])
@pytest.mark.parametrize("scale", [1.0, -1e-3])
def test_a_copy_is_refused_by_name(name, scale):
    (found,) = alike(view(np.round(scale * DRIVE + 0.1, 9), name))
    assert found.kind == "contradiction" and found.channel == f"command or {name}"
    assert "column command" in found.message and f"column {name}" in found.message


def test_what_a_controller_adds_to_is_no_copy():
    assert not alike(view(DRIVE + 1e-4 * RNG.normal(size=DRIVE.size)))
    assert not alike(view(np.zeros(DRIVE.size)))


def test_without_a_controller_the_command_is_what_is_injected():
    assert not alike(view(DRIVE, gains=NO_CONTROLLER))
    assert alike(view(DRIVE, rig=None, gains=None))
