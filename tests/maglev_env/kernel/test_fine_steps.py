"""Effects that are fast for a slow control rate: against the linear loop, tight integration and much finer steps."""

from dataclasses import replace

import numpy as np
import pytest
from reference_effects import simulate_effects

from maglev_env.design.default_gains import default_gains
from maglev_env.experiment import Experiment, protocol_experiment, without_noise
from maglev_env.kernel.blocks import own_lanes, prepared
from maglev_env.kernel.driven import Drive
from maglev_env.kernel.fine_steps import FAST, steps_on_effects
from maglev_env.kernel.gpu import refuse_on_gpu
from maglev_env.kernel.replay import replayed
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.linear.expected import expected_statistics
from maglev_env.loop.effect import effect
from maglev_env.loop.filtered_pid import FilteredPid, LowPass
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import PRESETS, load_rig

BALL = Rig("ball", "electromagnet", mass=0.06, gap=20e-3, bias_current=0.9, control_rate=200.0, adc_bits=0, dac_bits=0)
STAND = replace(
    load_rig("pedestal"), mass=0.06, support_stiffness=60.0, support_damping=0.2, adc_bits=0, control_rate=200.0
)
STICKY = effect("friction", 0.03, presliding=1e-6)
SMOOTH = effect("friction", 0.03)
STOP = effect("soft_stop", 2e-4)  # of the default stiffness
LINES = tuple(range(1, 20, 2))


def pushed(force, effects, waiting=4, rig=BALL):
    wave = Excitation("sphs", "force", 2.0, LINES, force)
    return without_noise(Experiment(rig, default_gains(rig), (wave,), 2, waiting, effects))


@pytest.mark.parametrize("effects", [SMOOTH, effect("friction", 0.03, velocity=1e-4), STICKY])
def test_small_motion_under_friction_on_a_slow_rig_is_that_of_the_linear_loop(effects):
    e = pushed(2e-6, effects, 30)
    found = simulate_statistics([e], threads=1).statistics
    expected = expected_statistics(e, found.lines).amplitude("displacement")
    np.testing.assert_allclose(found.amplitude("displacement")[0], expected, rtol=0, atol=1e-3 * abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    "effects, tolerance",
    [
        (SMOOTH, 1e-4),
        (STICKY, 1e-3),
        (effect("soft_stop", 2e-4, stiffness=1e3), 1e-2),
        (effect("soft_stop", 2e-4, stiffness=1e4, steepness=1.5), 1e-2),
        (effect("cubic_spring", 1e10), 1e-3),
    ],
)
def test_a_slow_rig_moves_as_the_equations_say(effects, tolerance):
    e = without_noise(replace(pushed(0.1, effects, 0), rig=STAND))
    expected = simulate_effects(e, 40, rtol=1e-7)[0][0]
    found = simulate_records([e], threads=1)[0][0, :40]
    assert np.abs(found - expected).max() < tolerance * np.abs(expected).max()


def test_a_stop_that_is_stiff_for_the_control_rate_holds_the_rotor():
    found = simulate_statistics([pushed(0.1, STOP), pushed(0.1, effect("soft_stop", 2e-4, stiffness=1e12))], threads=1)
    assert np.isnan(found.touchdown_time).all()
    fine = simulate_statistics([pushed(0.1, STOP)], substeps=256, threads=1).peak_displacement[0]
    assert found.peak_displacement[0] == pytest.approx(fine, rel=0.05)
    assert 2e-4 < found.peak_displacement[1] < 2.5e-4


@pytest.mark.parametrize("rate", [200.0, FAST])
def test_a_cubic_spring_that_is_too_stiff_for_the_step_holds_the_rotor(rate):
    rig = replace(STAND, control_rate=rate)
    every = [
        replace(pushed(2.0, effect("cubic_spring", coefficient), 0, rig=replace(BALL, control_rate=rate)), rig=rig)
        for coefficient in (1e15, 1e19, 1e20)
    ]
    found = simulate_statistics(every, threads=1)
    assert np.isnan(found.touchdown_time).all()
    assert found.peak_displacement[1] < found.peak_displacement[0] / 3


@pytest.mark.parametrize("preset", PRESETS)
def test_a_fast_rig_takes_one_step_and_a_slow_one_as_many_as_a_fast_one_has(preset):
    e = replace(
        protocol_experiment(load_rig(preset)),
        effects=effect("friction", 1.0, velocity=1e-5) | effect("soft_stop", 1e-5),
    )
    assert steps_on_effects(e) == 1
    assert steps_on_effects(pushed(0.1, {})) == 1 and steps_on_effects(pushed(0.1, effect("friction", 1e-4))) == 1
    assert steps_on_effects(pushed(0.1, effect("soft_stop", 2e-4, stiffness=1e12))) == FAST / BALL.control_rate


@pytest.mark.parametrize("rate, steps", [(200.0, 25), (1998.0, 3), (3000.0, 2), (4998.0, 2), (5000.0, 1)])
def test_no_more_steps_are_taken_than_bring_them_to_those_of_a_fast_rig(rate, steps):
    e = replace(pushed(0.1, effect("soft_stop", 2e-4, stiffness=1e12)), rig=replace(STAND, control_rate=rate))
    assert steps_on_effects(e) == steps
    assert 1 <= steps * rate / FAST < 2


def test_replay_with_other_gains_is_the_simulation_with_them_where_steps_are_fine():
    rig = replace(BALL, control_rate=1000.0)
    e = pushed(2e-4, STICKY | effect("delay", 7e-4), 0, rig)
    gains = (plain := default_gains(rig), replace(plain, kp=1.15 * plain.kp, td=1.2 * plain.td))
    filtered = [FilteredPid(g.kp, 0.0, g.kd, low_pass=LowPass(480.0)) for g in gains]
    for before, after in (gains, filtered):
        lanes, own = prepared([replace(e, gains=before)]), replace(e, gains=after)
        assert lanes[0].substeps > 1
        waves = {place: np.atleast_2d(own.waveform(place)) for place in ("force", "current", "reference")}
        found = replayed(lanes, [Drive(own, waves)], threads=1)[0][0]
        expected = simulate_records([own], substeps=lanes[0].substeps, threads=1)[0]
        n = found.shape[-1]
        np.testing.assert_array_equal(found[0, 0], expected[0, :n])


def test_lanes_of_different_steps_run_beside_one_another_as_alone():
    e = pushed(0.02, {})
    every = [replace(e, effects=effects) for effects in (STICKY, effect("friction", 0.0), SMOOTH, STICKY)]
    lanes = prepared(every)
    assert len({b.substeps for b in lanes}) > 1
    waves = {place: np.atleast_2d(e.waveform(place)) for place in ("force", "current", "reference")}
    (together,) = replayed(lanes, [Drive(every[0], waves)], threads=1)
    for own, found in zip(every, together, strict=True):
        np.testing.assert_array_equal(replayed(prepared([own]), [Drive(every[0], waves)], threads=1)[0][0], found)


def test_a_recording_between_the_control_samples_shows_the_same_motion():
    e = pushed(0.02, STICKY)
    plain = simulate_records([e], threads=1)[0]
    between = simulate_records([replace(e, sample_rate=3 * BALL.control_rate)], threads=1)[0]
    assert between.shape[1] == 3 * plain.shape[1]
    np.testing.assert_allclose(between[0, ::3], plain[0], rtol=0, atol=1e-3 * abs(plain[0]).max())


def test_a_gpu_refuses_what_needs_finer_steps_by_name():
    with pytest.raises(ValueError, match=r"--device cuda: friction: .*; use --device cpu"):
        refuse_on_gpu(own_lanes([pushed(0.1, STICKY)]))
