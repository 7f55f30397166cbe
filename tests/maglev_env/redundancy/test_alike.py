"""A command that is the injection, under whatever scale, is refused in a loop, and is right where nothing controls."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

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


@pytest.mark.parametrize(
    "copy",
    [
        np.round(DRIVE, 2),  # as a file with few digits holds it, of a range of 7
        DRIVE + 5e-4 * RNG.normal(size=DRIVE.size),  # of another converter
    ],
)
def test_a_copy_with_digits_or_noise_of_its_own_is_refused(copy):
    (found,) = alike(view(copy))
    assert found.kind == "contradiction" and "the same signal up to noise" in found.message


def test_a_copy_one_sample_later_is_refused():
    drive = RNG.normal(size=200_000)
    channels = {"displacement": 1e-5 * drive, "command": -0.1 * np.roll(drive, 1), "injection": drive}
    assert alike(replace(view(DRIVE), channels=channels))


def test_a_single_sine_is_no_copy_because_every_loop_only_turns_and_scales_it():
    t = np.arange(DRIVE.size) / RIG.control_rate
    sines = {"command": 1.7 * np.sin(2 * np.pi * 50 * t - 0.01), "injection": np.sin(2 * np.pi * 50 * t)}
    assert not alike(replace(view(DRIVE), channels={"displacement": 0 * t, **sines}))


def test_what_a_controller_adds_to_is_no_copy():
    # A loop of 30 Hz lets nearly all of what is injected up to 10 kHz pass as it is.
    pole = np.exp(-2 * np.pi * 30 / RIG.control_rate)
    high_pass = scipy.signal.lfilter([1.0, -1.0], [1.0, -pole], DRIVE)
    assert not alike(view(high_pass)) and not alike(view(high_pass, rig=None, gains=None))
    with np.errstate(all="raise"):
        assert not alike(view(np.zeros(DRIVE.size)))


def test_without_a_controller_the_command_is_what_is_injected():
    assert not alike(view(DRIVE, gains=NO_CONTROLLER))
    assert alike(view(DRIVE, rig=None, gains=None))
