"""Linear controllers and every kind of magnet in the lane kernel, against a slow simulator and against the PID."""

from dataclasses import replace

import numpy as np
import pytest
from controller_cases import BALL, SLOW, driven, pushed
from planar_rigs import COUPLED
from reference_simulator import simulate
from scipy.signal import butter, ss2tf

from maglev_env.experiment import axis_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import (
    Gains,
    LinearController,
    controller_response,
    realised,
    realised_together,
    state_space,
    states_of,
)
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig

DT = 1 / 20000.0
# Damped a little, so that every rig here runs in the same compiled kernels.
FREE = replace(load_rig("hmb_free"), support_damping=0.5, protocol=None)
SPRUNG = replace(FREE, mass=0.92, support_stiffness=134.5e3, support_damping=10.0)
PID = Gains(8000.0, 2000.0, 5.2)


def as_polynomials(gains, dt=DT):
    """The PID as numerator and denominator, by scipy."""
    a, b, c, d = state_space(gains, dt)
    numerator, denominator = ss2tf(a, b[:, None], c[None], np.array([[d]]))
    return LinearController(tuple(numerator[0]), tuple(denominator))


def in_series(first, second):
    """Two filters one after the other."""
    parts = ((first.numerator, second.numerator), (first.denominator, second.denominator))
    return LinearController(*(tuple(np.polymul(*pair)) for pair in parts))


ROLL_OFF = LinearController(*(tuple(c) for c in butter(3, 7000.0, fs=20000.0)))
CONTROLLERS = {
    "order 1, a lead": LinearController((60000.0, -53000.0), (1.0, -0.6)),
    "order 2, a lead one sample late": LinearController((60000.0, -53000.0), (1.0, -0.6, 0.0)),
    "order 2, the PID": as_polynomials(PID),
    "order 5, the PID and a roll-off": in_series(as_polynomials(PID), ROLL_OFF),
    "order 0, a gain": LinearController((2000.0,), (1.0,)),
}


def check_against_the_slow_simulator(e, samples, tolerance):
    slow = simulate(e, samples)
    fast = simulate_records([e])[0].reshape(4, e.rig.axes, -1)[..., :samples]
    for expected, got, name in zip(slow, fast, ("displacement", "command", "current"), strict=False):
        assert expected.shape[-1] == samples
        error, rms = (np.sqrt(np.mean(x**2, axis=-1)) for x in (got - expected, np.atleast_2d(expected)))
        assert (error <= tolerance * rms).all(), name
    return slow


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_linear_controller_agrees_with_a_tight_solve_ivp(name):
    rig = SPRUNG if name.endswith("a gain") else FREE
    e = driven(rig, CONTROLLERS[name])
    assert np.abs(closed_loop_poles(e)).max() < 1
    check_against_the_slow_simulator(e, 800, 5e-7)


@pytest.mark.slow
def test_two_linear_controllers_of_unlike_order_agree_with_a_tight_solve_ivp():
    pair = (CONTROLLERS["order 2, the PID"], CONTROLLERS["order 1, a lead"])
    e = driven(COUPLED, pair)
    e = replace(
        e, excitations=tuple(replace(x, direction=d) for x, d in zip(e.excitations, (35.0, -60.0), strict=True))
    )
    check_against_the_slow_simulator(e, 800, 5e-7)


def test_the_pid_as_polynomials_makes_the_same_record():
    e = driven(FREE, PID, force=5.0)
    other = replace(e, gains=as_polynomials(PID))
    pid, polynomial = simulate_records([e, other])
    rms = np.sqrt(np.mean(pid**2, axis=1))
    assert (np.sqrt(np.mean((pid - polynomial) ** 2, axis=1)) <= 1e-9 * rms).all()
    assert (pid != polynomial).any()


@pytest.mark.parametrize("name", CONTROLLERS)
def test_the_response_is_the_ratio_of_the_polynomials(name):
    c = CONTROLLERS[name]
    z = np.exp(2j * np.pi * np.array([1.0, 50.0, 900.0, 9000.0]) * DT)
    expected = np.polyval(c.numerator, z) / np.polyval(c.denominator, z)
    np.testing.assert_allclose(controller_response(c, z, DT), expected, rtol=1e-9)


def test_the_integrator_of_a_linear_controller_leaves_no_error():
    integral = LinearController((16.0,), (1.0, -1.0))
    lead = CONTROLLERS["order 1, a lead"]
    sums = np.polyadd(
        np.polymul(lead.numerator, integral.denominator), np.polymul(integral.numerator, lead.denominator)
    )
    both = LinearController(tuple(sums), tuple(np.polymul(lead.denominator, integral.denominator)))
    e = driven(FREE, both, force=1e-6, current=1e-6)
    e = replace(e, offset=2e-5, periods=40)
    assert simulate_records([e])[0][0, -1] == pytest.approx(2e-5, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("controller", [PID, CONTROLLERS["order 2, the PID"]], ids=["PID", "linear"])
def test_saturated_converters_feed_nothing_back_into_the_controller(controller):
    """The controller goes on from the command it asked for, not from the one that the converter gave."""
    e = driven(replace(SPRUNG, voltage_range=0.12), controller, force=6.0, current=0.05)
    displacement, command, _ = check_against_the_slow_simulator(e, 800, 5e-7)
    assert (np.abs(displacement) == 0.12 / e.rig.probe_gain).mean() > 0.01
    assert (np.abs(command) == 0.12).mean() > 0.1


def test_a_linear_controller_is_quantised_like_the_pid():
    e = driven(FREE, PID)
    e = replace(e, rig=replace(e.rig, adc_bits=10, dac_bits=8, rounds=True))
    pid, polynomial = simulate_records([e, replace(e, gains=CONTROLLERS["order 2, the PID"])])
    steps = polynomial[1] / (20 / 2**8)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert np.unique(np.round(steps)).size > 5
    # One rounding that falls the other way lasts; the first hundred samples have none.
    np.testing.assert_allclose(polynomial[:3, :100], pid[:3, :100], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("numerator", "denominator", "words"),
    [
        ((1.0, 2.0), (1.0,), "need the future"),
        ((1.0,), (2.0, 1.0), "starts with 2"),
        ((1.0,), (0.0, 1.0), "starts with 0"),
        ((), (1.0,), "numerator"),
        ((1.0,), (), "denominator"),
        ((float("nan"),), (1.0,), "numerator"),
        ((1.0,), (1.0, float("inf")), "denominator"),
    ],
)
def test_coefficients_that_make_no_controller_are_refused(numerator, denominator, words):
    with pytest.raises(ValueError, match=words):
        LinearController(numerator, denominator)


def test_a_pid_beside_a_linear_controller_is_refused():
    e = driven(COUPLED, (PID, CONTROLLERS["order 1, a lead"]))
    with pytest.raises(ValueError, match="both axes"):
        simulate_records([e])


COIL = Rig("coil", "magnet_coil", mass=0.02, gap=15e-3, force_constant=2e-8, force_exponent=4.0, **SLOW)
RIGS = {
    "electromagnet": BALL,
    "air coil": COIL,
    "iron coil": replace(
        COIL, force_exponent=2.5, force_constant=1e-5, pole_area=5e-5, magnet_area=8e-5, remanence=1.0
    ),
    "coil that pushes": replace(COIL, remanence=1.0, magnet_length=5e-3, magnet_area=1e-4),
    "electromagnet pair": replace(load_rig("eframe"), protocol=None, control_rate=20000.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.05, 3.0], ids=["small", "large"])
@pytest.mark.parametrize("name", RIGS)
def test_every_kind_of_magnet_agrees_with_a_tight_solve_ivp(name, share):
    e = pushed(RIGS[name], share)
    displacement, _, _ = check_against_the_slow_simulator(e, 600, 2e-6)
    if share == 3.0:
        assert np.abs(displacement).max() > 0.08 * e.rig.gap


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_a_calibrated_magnet_with_its_effects_agrees_with_a_tight_solve_ivp(name):
    gain, stiffness = linearise(force_law(RIGS[name]))
    calibrated = {"actuator_gain": 1.2 * gain} | ({"negative_stiffness": 0.8 * stiffness} if stiffness < 0 else {})
    e = pushed(replace(RIGS[name], **calibrated), 0.3)
    effects = {**effect("actuator_gain", 0.1), **effect("negative_stiffness", -0.1), **effect("delay", 0.3 / 4000)}
    check_against_the_slow_simulator(replace(e, effects=effects), 600, 2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["electromagnet", "iron coil"])
def test_a_heavier_rotor_hangs_lower(name):
    """The bias carries the nominal weight: another mass is a static load of its own."""
    e = replace(pushed(RIGS[name], 0.05), effects=effect("mass", 0.05))
    displacement, _, _ = check_against_the_slow_simulator(e, 600, 2e-6)
    assert displacement[300:].mean() < -2 * np.abs(simulate(replace(e, effects={}), 600)[0]).std()


@pytest.mark.slow
def test_a_pair_in_two_axes_is_twice_a_pair_in_one():
    pair = RIGS["electromagnet pair"]
    e = pushed(pair, 0.2)
    turned = tuple(replace(x, direction=90.0) for x in e.excitations)
    both = simulate_records([replace(e, rig=replace(e.rig, axes=2), excitations=turned)])[0].reshape(4, 2, -1)
    # The compiled step of two axes contracts its sums otherwise: the last digits differ.
    alone = simulate_records([e])[0]
    np.testing.assert_allclose(both[:, 1], alone, rtol=1e-11, atol=1e-14 * abs(alone).max())
    assert not both[:, 0].any()
    assert axis_experiment(replace(e, rig=replace(e.rig, axes=2)), 1).rig.magnet == "electromagnet_pair"


def test_controllers_are_realised_together_as_one_by_one():
    rng, dt = np.random.default_rng(2), 5e-5
    pids = [Gains(*rng.uniform(1, 1e4, 3), *rng.uniform(1e-5, 1e-1, 2)) for _ in range(5)]
    for several in (pids, [LinearController((1.0, number), (1.0, -0.5)) for number in (2.0, 3.0)]):
        together = realised_together(several, dt)
        for part, own in zip(together, zip(*(realised(one, dt) for one in several), strict=True), strict=True):
            np.testing.assert_array_equal(part, np.array(own))
        assert {states_of(one, dt) for one in several} == {together[2].shape[1]}
