"""The analytic sampled loop in x and y: against a continuous-time derivation, and against small simulated motion."""

from dataclasses import replace

import numpy as np
import pytest
from planar_loops import check_every_line, small
from planar_rigs import COUPLED, CROSS, EVERY_EFFECT, FREE, GAINS, OTHER_Y, UNLIKE
from scipy.signal import dlsim

from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.linear.expected import expected_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop, closed_loop_poles
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains, LinearController
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Noise

RATE = 20000.0
PAIR = (
    LinearController((60000.0, -53000.0), (1.0, -0.6)),
    LinearController((40000.0, -34000.0, 500.0), (1.0, -0.5, 0.1)),
)


def physical(s, delay=0.0):
    """Readings per held command and per force, 2 x 2 each, at one complex s (rad/s): the equations by hand."""
    x = {name: getattr(FREE, name) for name in OTHER_Y}
    each = (x, OTHER_Y)
    mass, k, lag_a, lag_s, gain = (
        np.array([axis[name] for axis in each])
        for name in (
            "mass", "support_stiffness", "amplifier_time_constant", "sensor_time_constant", "actuator_gain"
        )
    )  # fmt: skip
    k = k + np.array([axis["negative_stiffness"] for axis in each])
    stiffness = np.array([[k[0], CROSS.stiffness_xy], [CROSS.stiffness_yx, k[1]]])
    damping = np.array([[0, CROSS.damping_xy], [CROSS.damping_yx, 0]])
    gains = np.array([[gain[0], CROSS.gain_xy], [CROSS.gain_yx, gain[1]]])
    mix = np.array([[1, CROSS.sensor_xy], [CROSS.sensor_yx, 1]])
    moved = mix @ np.diag(1 / (1 + s * lag_s)) @ np.linalg.inv(np.diag(mass) * s**2 + damping * s + stiffness)
    return moved @ gains @ np.diag(1 / (1 + s * lag_a)) * np.exp(-s * delay), moved


def sampled(f, delay=0.0, aliases=400):
    """What sampling and a hold make of `physical`: the sum over all images of f, (2, 2) each."""
    total = np.zeros((2, 2, 2), complex)
    for image in range(-aliases, aliases + 1):
        s = 2j * np.pi * (f + image * RATE)
        total += np.array(physical(s, delay)) * (1 - np.exp(-2j * np.pi * f / RATE)) / s * RATE
    return total


def ratio(g, f):
    """Command per error of a controller."""
    z = np.exp(2j * np.pi * f / RATE)
    if isinstance(g, LinearController):
        return np.polyval(g.numerator, z) / np.polyval(g.denominator, z)
    a, b = np.exp(-1 / RATE / g.td), np.exp(-1 / RATE / g.ti)
    return g.kp + g.kd / g.td * (z - 1) / (z - a) + g.ki * (1 - b) / (z - b)


@pytest.mark.parametrize("gains", [GAINS, PAIR], ids=["PID", "linear"])
@pytest.mark.parametrize("delay", [0.0, 18e-6, 50e-6, 61.7e-6])
def test_responses_are_the_continuous_equations_held_and_sampled(delay, gains):
    f = np.array([3.0, 47.0, 110.0, 800.0, 5000.0, 9500.0])
    response = loop_response(small(gains=gains, effects=effect("delay", delay)), f)
    for i, line in enumerate(f):
        plant, receptance = sampled(line, delay)
        controller = np.diag([ratio(g, line) for g in gains])
        # Two by two by hand, in the order that matrices do not commute.
        sensitivity = np.linalg.inv(np.eye(2) + controller @ plant)
        closed = np.linalg.solve(np.eye(2) + plant @ controller, receptance)
        for name, expected in (
            ("controller", controller),
            ("plant", plant),
            ("loop_gain", controller @ plant),
            ("sensitivity", sensitivity),
            ("receptance", closed),
            ("force_to_command", -controller @ closed),
        ):
            got = getattr(response, name)
            assert got.shape == (len(f), 2, 2)
            # The images left out are below 1e-7 of the largest element.
            assert np.abs(got[i] - expected).max() < 1e-6 * np.abs(expected).max(), name
            off = np.abs(got[i] - expected)[~np.eye(2, dtype=bool)]
            assert (off <= 1e-5 * np.abs(expected)[~np.eye(2, dtype=bool)]).all(), name


@pytest.mark.parametrize("gains", [GAINS, PAIR], ids=["PID", "linear"])
def test_the_loop_has_no_inverse_at_its_poles(gains):
    delay = 61.7e-6
    poles = closed_loop_poles(small(gains=gains, effects=effect("delay", delay)))
    slow = poles[np.abs(poles) > 0.9]
    assert slow.size >= 3 and np.abs(poles).max() < 1

    def determinant(z):
        # Off the circle too, a response is that of its z = exp(j 2 pi f / rate), f complex.
        f = np.log(z) / (2j * np.pi) * RATE
        return abs(np.linalg.det(np.eye(2) + np.diag([ratio(g, f) for g in gains]) @ sampled(f, delay)[0]))

    for z in slow:
        # The determinant vanishes there, and not a thousandth of the way from the pole to the circle's centre.
        assert determinant(z) < 1e-3 * determinant(0.999 * z)


def test_without_coupling_the_poles_and_responses_are_those_of_each_axis():
    e = small(UNLIKE, effects=EVERY_EFFECT)
    own = [axis_experiment(e, axis) for axis in (0, 1)]
    expected = np.concatenate([closed_loop_poles(o) for o in own])
    got = closed_loop_poles(e)
    assert got.size == expected.size
    distance = np.abs(got[:, None] - expected)
    assert max(distance.min(axis=0).max(), distance.min(axis=1).max()) < 1e-5  # double poles at 0 are that soft
    f = np.array([10.0, 300.0, 4000.0])
    both = loop_response(e, f)
    for axis, o in enumerate(own):
        alone = loop_response(o, f)
        for name in ("controller", "plant", "receptance", "force_to_command", "loop_gain", "sensitivity"):
            np.testing.assert_allclose(getattr(both, name)[:, axis, axis], getattr(alone, name), rtol=1e-9)
            assert not getattr(both, name)[:, axis, 1 - axis].any()


@pytest.mark.parametrize("gains", [GAINS, PAIR], ids=["PID", "linear"])
def test_the_sampled_system_run_by_scipy_is_the_small_simulated_motion(gains):
    e = small(gains=gains, effects=EVERY_EFFECT, transient_periods=0)
    e = replace(e, excitations=e.excitations[:1])
    a, b, c = closed_loop(e)
    _, expected, _ = dlsim((a, b, c, np.zeros((2, 2)), 1 / RATE), np.tile(e.waveform("force"), 2).T)
    got = simulate_records([e])[0][:2].T
    error, rms = np.sqrt(np.mean((got - expected) ** 2, axis=0)), np.sqrt(np.mean(expected**2, axis=0))
    assert (error <= 1e-6 * rms).all()


@pytest.mark.parametrize("effects", [{}, EVERY_EFFECT], ids=["nominal", "every effect"])
@pytest.mark.parametrize("gains", [GAINS, PAIR], ids=["PID", "linear"])
def test_a_small_experiment_is_the_analytic_loop_at_every_line(effects, gains):
    check_every_line(small(gains=gains, effects=effects))


def test_the_coupling_pushes_what_a_rotor_that_bends_does_not_have_on_its_spring():
    check_every_line(small(effects=effect("support_resonance", 300.0, mass_ratio=0.3, inside=1.0)))


@pytest.mark.parametrize("effects", [{}, EVERY_EFFECT], ids=["nominal", "every effect"])
def test_a_small_experiment_is_the_analytic_loop_up_to_2_khz_without_cross_gain(effects):
    rig = replace(COUPLED, cross=replace(CROSS, gain_xy=0.0, gain_yx=0.0))
    check_every_line(small(rig, lines=(2, 6, 10, 20, 40), effects=effects))


def noisy(rig, lines):
    """Half-second periods, and so many of them that a mean covariance over lines and lanes is known to 2 %."""
    force = Excitation("sphs", "force", 2.0, lines, 1e-3, direction=30.0)
    gains = (FREE.gains, Gains(14000.0, 2000.0, 9.0))  # far apart: controllers of one kind commute with what they close
    batch = [Experiment(rig, gains, (force,), periods=12, transient_periods=2, seed=s) for s in range(16)]
    return simulate_statistics(batch).statistics, expected_statistics(batch[0], np.array(lines))


@pytest.mark.slow
def test_the_expected_covariance_is_what_noise_in_both_axes_leaves():
    quiet = replace(COUPLED, noise=Noise(1e-7, 1e-4, 0.0), adc_bits=0, dac_bits=0)
    got, expected = noisy(quiet, tuple(range(60, 100)))
    found = got.covariance.mean(axis=0)
    size = np.sqrt(np.einsum("iin->in", expected.covariance).real)[:6]
    assert (size > 0).all()
    error = (found - expected.covariance)[:6, :6] / (size[:, None] * size[None])
    # Each line's mean over 16 lanes scatters by 0.08; what leaks from a free period into the next adds to it.
    assert np.abs(error.mean(axis=2)).max() < 0.05
    correlated = np.abs(expected.covariance[:6, :6] / (size[:, None] * size[None])).mean(axis=2)
    assert correlated[0, 1] > 0.15 and correlated[0, 2] > 0.99
    assert not found[6:].any() and not expected.covariance[6:].any()


def test_sign_conventions_of_the_two_axes():
    """A static push along y moves x by the cross stiffness: K q = F, solved by hand with the loop's static gain."""
    rig = replace(FREE, cross=replace(CROSS, damping_xy=0.0, damping_yx=0.0, gain_xy=0.0, gain_yx=0.0, sensor_xy=0.0,
                                      sensor_yx=0.0))  # fmt: skip
    response = loop_response(Experiment(rig, FREE.gains, ()), np.array([1e-3]))
    held = 5.7 * (FREE.gains.kp + FREE.gains.ki) - 12.5e3 + FREE.support_stiffness
    k = np.array([[held, CROSS.stiffness_xy], [CROSS.stiffness_yx, held]])
    np.testing.assert_allclose(response.receptance[0], np.linalg.inv(k), rtol=1e-4)
