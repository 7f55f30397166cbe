"""Default gains: stable and robust on the linearised loop, and holding the rotor by the whole force law."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from maglev_env.design.default_gains import default_gains
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force, linearise
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig, axis_rig
from maglev_env.rig.rig_file import load_rig

BALL = Rig("ball", "electromagnet", mass=0.058, gap=10e-3, turns=1000, pole_area=3e-4, control_rate=1000.0)
COIL = Rig("coil", "magnet_coil", mass=0.02, gap=15e-3, force_constant=2e-8, force_exponent=4.0, control_rate=1000.0)
REPELLED = replace(COIL, remanence=1.0, magnet_length=5e-3, magnet_area=1e-4)
RIGS = {
    "hmb_free": load_rig("hmb_free"),
    "hmb_radial": axis_rig(load_rig("hmb_radial"), 0),
    "eframe": load_rig("eframe"),
    "ball": BALL,
    "coil": COIL,
    "repelled": REPELLED,
    "voice coil": replace(load_rig("eframe"), mass=2.4, actuator_gain=12.5, negative_stiffness=0.0),
}


def loop(rig):
    """Pole radius and peak sensitivity of the nominal loop at the rig's default gains."""
    e = Experiment(rig, default_gains(rig), (Excitation("multisine", "force", 1.0, (1,)),))
    s = loop_response(e, np.geomspace(1e-5, 0.5, 800) * rig.control_rate).sensitivity
    return np.abs(closed_loop_poles(e)).max(), np.abs(s).max()


@pytest.mark.parametrize("name", RIGS)
def test_every_kind_of_magnet_levitates_robustly(name):
    radius, peak = loop(RIGS[name])
    assert radius < 1 and peak < 1.5


@pytest.mark.parametrize("name", ["hmb_free", "eframe", "ball", "coil"])
def test_the_magnet_keeps_about_its_own_stiffness(name):
    rig = RIGS[name]
    gain, stiffness = linearise(force_law(rig))
    assert gain * default_gains(rig).kp == pytest.approx(-2 * stiffness, rel=0.01)


@pytest.mark.parametrize("name", ["eframe", "ball", "coil"])
def test_a_displaced_rotor_comes_back_under_the_whole_law(name):
    rig = RIGS[name]
    g, law, dt = default_gains(rig), force_law(rig), 1 / rig.control_rate
    state, d, x = np.array([-0.1 * rig.gap, 0.0]), 0.0, 0.0
    duration = 10 / np.sqrt(abs(linearise(law)[1]) / rig.mass)
    for _ in range(round(duration / dt)):
        error = -state[0]
        u = g.kp * error + g.kd * (error - d) / g.td + g.ki * x
        d += (1 - np.exp(-dt / g.td)) * (error - d)
        x += (1 - np.exp(-dt / g.ti)) * (error - x)

        def motion(_t, s, u=u):
            return [s[1], force(law, s[0], u) / rig.mass]

        state = solve_ivp(motion, (0, dt), state, rtol=1e-6, atol=1e-12).y[:, -1]
        assert abs(state[0]) < 0.15 * rig.gap
    assert abs(state[0]) < 1e-3 * rig.gap


def test_the_e_frames_own_gains_meet_its_target_and_its_protocol_stays_near_the_centre():
    rig = RIGS["eframe"]
    e = protocol_experiment(rig)
    n = e.samples_per_period
    response = loop_response(e, np.arange(1, n // 2))
    assert np.abs(closed_loop_poles(e)).max() < 1
    assert np.abs(response.sensitivity).max() < rig.target.peak_sensitivity
    force, injection = (np.fft.rfft(e.waveform(place))[1 : n // 2] for place in ("force", "current"))
    displacement = response.receptance * force + response.plant * response.sensitivity * injection
    command = response.force_to_command * force + response.sensitivity * injection
    peak_y, peak_u = (np.abs(np.fft.irfft(np.concatenate([[0], x, [0]]))).max() for x in (displacement, command))
    assert 0.02 * rig.gap < peak_y < 0.05 * rig.gap
    assert peak_u < rig.bias_current


def test_random_rigs_are_robust_while_samples_and_lags_are_short_of_the_time_to_fall():
    rng = np.random.default_rng(3)
    slow = 0
    for _ in range(60):
        gap = 10 ** rng.uniform(-3.5, -1.5)
        rate = np.sqrt(2 * 9.80665 / gap)  # of the fall, 1/s
        share = rng.uniform(0.01, 0.39)  # of the time to fall: sampling and lags together
        sample, amplifier, sensor = share * rng.dirichlet([1, 1, 1]) / rate
        rig = Rig(
            "random",
            "electromagnet",
            mass=10 ** rng.uniform(-2, 2),
            gap=gap,
            turns=300,
            pole_area=3e-4,
            control_rate=1 / max(sample, 1e-6),
            amplifier_time_constant=amplifier,
            sensor_time_constant=sensor,
        )
        radius, peak = loop(rig)
        assert radius < 1 and peak < 3.0
        slow += peak > 1.9
        if share < 0.2:
            assert peak < 2.05
    assert slow > 5  # the limit is reached, not only approached


def test_slow_loops_are_given_faster_derivatives():
    fast, slow = default_gains(BALL), default_gains(replace(BALL, control_rate=150.0))
    assert fast.td >= 2 / BALL.control_rate
    assert slow.td == pytest.approx(0.5 / 150.0, rel=0.01)


def test_what_no_variant_makes_robust_is_searched_for_the_calmest_loop():
    """A magnet of 16 g at 49 Hz and a ball at 100 Hz: compensated for all lags they had peaks of 13.8 and 6.1."""
    magnet = replace(COIL, mass=0.016, gap=60e-3, control_rate=49.0, amplifier_time_constant=2e-3)
    ball = replace(BALL, mass=0.018, gap=30e-3, control_rate=100.0, amplifier_time_constant=12e-3)
    for rig in (magnet, replace(ball, sensor_time_constant=1e-3)):
        radius, peak = loop(rig)
        assert radius < 1 and peak < 4.2
        own = default_gains(rig)
        for kp, kd in ((0.9, 1.0), (1.1, 1.0), (1.0, 0.8), (1.0, 1.25)):
            e = Experiment(rig, replace(own, kp=kp * own.kp, kd=kd * own.kd), ())
            s = loop_response(e, np.geomspace(1e-5, 0.5, 800) * rig.control_rate).sensitivity
            assert np.abs(closed_loop_poles(e)).max() >= 1 or np.abs(s).max() > 0.99 * peak


def test_what_cannot_be_levitated_says_why():
    with pytest.raises(ValueError, match="hmb_axial has no magnets"):
        default_gains(load_rig("hmb_axial"))
    with pytest.raises(ValueError, match=r"ball: no default gains stabilise it.*leaves its centre in.*control_rate"):
        default_gains(replace(BALL, control_rate=100.0, amplifier_time_constant=0.05))
    with pytest.raises(ValueError, match="swings on its support"):
        default_gains(replace(load_rig("hmb_free"), support_stiffness=1e7))
    with pytest.raises(ValueError, match="2 axes"):
        default_gains(replace(load_rig("hmb_free"), axes=2))
