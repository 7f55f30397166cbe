"""What moves a simulation between the samples of a recording."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

from maglev_env.experiment import Experiment
from maglev_env.loop.gains import NO_CONTROLLER, Gains, controller_output
from maglev_env.recordings.campaign import RecordingSpec
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from sim2real.recorded.drive.drive import Drive, drive_of

RATE = 600.0
GAINS = Gains(8000.0, 2000.0, 5.2, 1e-4)
TIME = np.arange(6000) / RATE
FREE = Rig("springs", "none", mass=0.9, support_stiffness=134e3, support_damping=30.0, control_rate=RATE)
EQUATION = [FREE.mass, FREE.support_damping, FREE.support_stiffness]  # a resonance at 61 Hz


def response(frequency, held, every):
    """Amplitude and phase of the displacement at recorded samples over those of a sinusoidal force."""
    wave = np.sin(2 * np.pi * frequency * TIME)
    drive = Drive(Experiment(FREE, NO_CONTROLLER, ()), force_held=held, every=every)
    force = drive.driving({"displacement": np.zeros((1, TIME.size)), "force": wave[None]}).waves["force"][0]
    numerator, denominator, _ = scipy.signal.cont2discrete(([1.0], EQUATION), 1 / RATE / every)
    moved = scipy.signal.lfilter(numerator.ravel(), denominator, force)[::every]
    middle = slice(2000, 4000)  # a whole number of periods, after the transient
    reference = np.exp(-2j * np.pi * frequency * TIME[middle])
    return (moved[middle] @ reference) / (wave[middle] @ reference)


@pytest.mark.parametrize("frequency", [30.0, 61.2, 120.0, 210.0])
def test_a_continuous_force_acts_when_it_was_read(frequency):
    """Against the differential equation; held over its samples a force would act half a sample later."""
    exact = 1 / np.polyval(EQUATION, 2j * np.pi * frequency)
    assert abs(response(frequency, False, 9) / exact - 1) < 0.001
    assert abs(response(frequency, False, 2) / exact - 1) < 0.02
    assert abs(response(frequency, True, 9) / exact - 1) > 0.1


@pytest.mark.parametrize(("intersample", "held"), [("zoh", True), ("bl", False), (None, False)])
def test_a_force_is_held_only_where_the_campaign_says_so(intersample, held):
    spec = RecordingSpec("run.csv", "fit", RATE, 0, None, None, 0.0, None, (), {}, intersample)
    drive = drive_of(FREE, spec, {"displacement": np.zeros((1, 100)), "force": np.arange(100.0)[None]})
    assert drive.force_held == held and drive.every == (1 if held else 9)


@pytest.mark.parametrize(("lag", "held"), [(0.0, True), (1e-5, True), (1.2 / RATE, False)])
def test_a_current_behind_an_amplifier_that_lags_is_not_held(lag, held):
    """Held by the converter is the command; a current taken as held acts half a sample late, which looks like a lag."""
    rig = replace(load_rig("hmb_free"), control_rate=RATE, amplifier_time_constant=lag)
    spec = RecordingSpec("run.csv", "fit", RATE, 0, None, None, 0.0, None, (), {}, "zoh")
    moved = 1e-5 * np.sin(2 * np.pi * 20.0 * TIME)[None]
    drive = drive_of(rig, spec, {"displacement": moved, "current": 1e4 * moved})
    assert drive.source == "current" and drive.held == held


def test_what_the_converter_rounds_off_a_command_is_not_made_by_another_controller():
    """The steps of an 8 bit converter are a tenth of a small command."""
    rig = replace(load_rig("hmb_free"), control_rate=5000.0)
    drive = Drive(Experiment(rig, GAINS, ()), "command")
    rng = np.random.default_rng(3)
    y, injection = 1e-7 * rng.normal(size=(1, 8000)), 0.2 * rng.normal(size=(1, 8000))
    made = injection + controller_output(GAINS, dt=1 / 5000, displacement=y[0])
    step = 2 * rig.voltage_range * rig.amplifier_gain / 2**8
    channels = {"displacement": y, "injection": injection, "command": step * np.round(made / step)}
    share = step / np.sqrt(12) / channels["command"].std()
    assert share > 0.1 and drive.not_made(channels) == pytest.approx(share, rel=0.05)
    assert drive.not_made(channels, step / np.sqrt(12)) < 0.2 * share
