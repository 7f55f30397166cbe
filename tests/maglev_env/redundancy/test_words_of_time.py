"""Half a sample between a held and a smooth force, samples that were bridged, integrals that count in samples."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.loop.controller_forms import Pid
from maglev_env.redundancy.coupling import coupled, decoupled
from maglev_env.redundancy.explained import explained
from maglev_env.redundancy.periods import outliers
from maglev_env.redundancy.rows import Row
from maglev_env.redundancy.view import View
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig

RIG = load_rig("hmb_free")
RATE = RIG.control_rate
SAMPLES, PERIODS = 4000, 8


def view(gains=RIG.gains, **channels):
    names = frozenset(channels)
    drive = Excitation("multisine", "current", RATE / SAMPLES, tuple(range(1, 61)), 0.1)
    return View("run", RATE, channels, names, {n: n for n in names}, (drive,), frozenset(), gains, (), RIG, RIG.mass)


@pytest.mark.parametrize(
    ("late", "held", "says"), [(0.5, True, '"bl"'), (-0.5, False, '"zoh"'), (-0.5, True, ""), (1.0, True, "")]
)
def test_a_force_that_is_half_a_sample_off_asks_what_it_is_between_samples(late, held, says):
    row = Row("newton force", {"displacement": 1, "force": -1, "mass": 1}, 1.0, 1e-3, 0.1, "the force on 1 kg",
              -late / RATE, 0.01 / RATE, 0.3 / RATE, delay_effects=("damping",))  # fmt: skip
    one = replace(view(displacement=np.ones(9), force=np.ones(9)), hold_rate=RATE if held else None)
    (found,) = explained(one, [row])
    assert ("intersample" in found.message) == bool(says) and says in found.message


@pytest.mark.parametrize(
    ("tolerance", "says"), [(0.25, "check the scale of column"), (0.05, "agrees with what it does")]
)
def test_a_column_agrees_only_with_what_would_show_its_factor(tolerance, says):
    """What mass, probe and gain leave open by 25 % does not tell a force of 1.12 times its stated peak from a scale."""
    peak = Row("designed force", {"force": 1}, 1.12, 1e-3, 0.1, "its stated 1 N peak")
    seen = 1 / 1.12 if tolerance > 0.1 else 1.0
    newton = Row(
        "newton force", {"displacement": 1, "force": -1, "mass": 1}, seen, 1e-3, tolerance, "the force on 1 kg"
    )
    (found,) = explained(view(displacement=np.ones(9), force=np.ones(9)), [peak, newton])
    assert found.channel == "force" and says in found.message


@pytest.mark.parametrize("told", [True, False])
def test_what_was_bridged_for_another_channel_is_no_spike(told):
    """The clipped current hides a few samples of all periods but one, other ones in each."""
    rng = np.random.default_rng(1)
    total = SAMPLES * PERIODS
    wave = np.tile(np.sin(2 * np.pi * 40 * np.arange(SAMPLES) / SAMPLES), PERIODS)
    force, masked = wave + 1e-3 * rng.normal(size=total), np.zeros(total, bool)
    for p in range(PERIODS):
        masked[p * SAMPLES + 100 + 7 * p :][:12] = True
    at = np.arange(total)
    bridged = np.interp(at, at[~masked], force[~masked])
    one = view(displacement=wave + 1e-3 * rng.normal(size=total), force=bridged)
    found = outliers(replace(one, masked=masked if told else None))
    assert [f.code for f in found] == ([] if told else ["spike"])


@pytest.mark.parametrize(("event", "found"), [(False, []), (True, ["period"])])
def test_what_turns_beside_the_lines_is_nothing_that_happened(event, found):
    """51 Hz between lines of 2 Hz, as of a runout, is reversed in each second period."""
    rng, at = np.random.default_rng(4), np.arange(PERIODS * SAMPLES)
    wave = np.tile(np.sin(2 * np.pi * 40 * np.arange(SAMPLES) / SAMPLES), PERIODS)
    wave += 0.3 * np.sin(2 * np.pi * 25.5 * at / SAMPLES) + 1e-3 * rng.normal(size=at.size)
    wave[3 * SAMPLES : 4 * SAMPLES] += 0.3 * event * np.sin(2 * np.pi * 7 * np.arange(SAMPLES) / SAMPLES)
    assert [f.code for f in outliers(view(displacement=wave))] == found


def _loop_less(rng, ki):
    """A displacement of many lines, and the command that a program makes of it, sample by sample."""
    n, dt = SAMPLES, 1 / RATE
    spectrum = np.zeros(n // 2 + 1, complex)
    spectrum[1:61] = 1e-5 * np.exp(2j * np.pi * rng.random(60)) * n / 2
    y = np.tile(np.fft.irfft(spectrum, n), PERIODS)
    kp, kd, total, slope, before, command = 8000.0, 5.0, 0.0, 0.0, 0.0, np.empty(y.size)
    for k, value in enumerate(y):
        total -= ki * dt * value
        slope = (1e-4 * slope - kd * (value - before)) / (1e-4 + dt)
        before = value
        command[k] = slope - kp * value + total
    return y, command + 1e-4 * rng.normal(size=y.size)


def test_an_integral_gain_of_one_sample_is_no_ac_coupling():
    y, command = _loop_less(np.random.default_rng(2), 3e5)
    stated = Pid(8000.0, 3e5 / RATE, 5.0, 1e-4)
    wrong = view(stated, displacement=y, command=command)
    (found,) = coupled(wrong)
    assert found.channel == "gains" and found.value == pytest.approx(3e5, rel=0.03) and "control rate" in found.message
    assert not coupled(decoupled(wrong, found))
    assert not coupled(view(replace(stated, ki=3e5), displacement=y, command=command))


def test_a_gain_that_is_wrong_by_another_factor_is_told_beside_the_coupling_or_alone():
    y, command = _loop_less(np.random.default_rng(3), 3e5)
    (found,) = coupled(view(Pid(8000.0, 1e5, 5.0, 1e-4), displacement=y, command=command))
    assert "gains" in found.channel and "ki" in found.message
