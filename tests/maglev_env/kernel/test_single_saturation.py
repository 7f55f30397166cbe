"""A knee at the current or the command of a single magnet: lanes, linear loop and equations agree about the balance."""

from dataclasses import replace
from math import exp, inf

import numpy as np
import pytest
from scipy.optimize import brentq

from maglev_env.experiment import Experiment
from maglev_env.kernel.lanes import structure_of
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig

REST = 0.9
BALL = Rig(
    "ball", "electromagnet", mass=0.0583, gap=11e-3, bias_current=REST, amplifier_time_constant=1e-3,
    sensor_time_constant=3e-4, adc_bits=0, dac_bits=0, control_rate=1000.0,
)  # fmt: skip
HUNG = 0.0583 * BALL.gravity * 15e-3**2.5 / 0.8
FLOATING = replace(
    BALL, magnet="magnet_coil", gap=15e-3, force_constant=HUNG, force_exponent=2.5, bias_current=0.8,
    amplifier_time_constant=0.0,
)  # fmt: skip
GAINS = Gains(kp=480.0, ki=500.0, kd=8.0, td=1.5e-3, ti=0.5)
KNEES = {
    "current": effect("saturation", current=1.5, sharpness=2.5),
    "command": effect("saturation", command=1.2),
    "both": effect("saturation", current=2.0, command=1.8, sharpness=3.0),
}
FLUX = {
    "flux": effect("saturation", current=1.5, sharpness=2.5, distance_share=1.0),
    "creeping flux": effect("saturation", current=0.8, sharpness=5.0, creep=0.2, distance_share=1.0),
}
CREEPING = {**KNEES, "creeping": effect("saturation", current=1.1, command=1.8, sharpness=5.0, creep=0.2)}
LONG = replace(BALL, force_length=6e-3)
RIGS = {"ball": BALL, "calibrated ball": replace(BALL, actuator_gain=1.0, negative_stiffness=-95.0), "coil": FLOATING}


def moved(rig, effects, amplitude=3e-4, lines=(1, 3, 8), **more):
    drive = Excitation("sphs", "reference", 1.0, lines, amplitude)
    return Experiment(rig, GAINS, (drive,), periods=1, transient_periods=0, effects=effects, **more)


def through(rest, knee, sharpness, creep=0.0):
    """Slope of the knee where it passes what must flow at rest, found by search, and what enters it there."""
    if knee == inf:
        return 1.0, rest
    at, step = brentq(lambda i: bend(i, knee, sharpness, creep) - rest, 0.0, 100.0, xtol=1e-14), 1e-5
    return (bend(at + step, knee, sharpness, creep) - bend(at - step, knee, sharpness, creep)) / (2 * step), at


def bend(i, knee, sharpness, creep=0.0):
    return i / (1 + abs(i / knee) ** sharpness) ** ((1 - creep) / sharpness)


def integrated(e, samples, steps=40):
    """Readings, commands and currents, (3, samples): the equations of motion, by classical steps of their own."""
    rig, g, dt = e.rig, e.gains, 1 / e.rig.control_rate
    values = {
        "current": inf, "command": inf, "sharpness": 4.0, "distance_share": 0.0, "creep": 0.0,
        **e.effects.get("saturation", {}),
    }  # fmt: skip
    knee, top, n, by_flux, creep = (
        values[key] for key in ("current", "command", "sharpness", "distance_share", "creep")
    )
    rest, weight = rig.bias_current, rig.mass * rig.gravity
    carried = through(rest, knee, n, creep)[1]
    asked = through(carried, top, n, creep)[1]
    # What pulls is C I^2 / x^2, or C I / x^n; a measured gain or stiffness scales its part.
    power, fall = (2, 2.0) if rig.magnet == "electromagnet" else (1, rig.force_exponent)
    strength = weight * rig.gap**fall / rest**power
    a = (rig.actuator_gain or 0.0) / (power * weight / rest) or 1.0
    b = (rig.negative_stiffness or 0.0) / (-fall * weight / rig.gap) or 1.0

    def nearer(y):
        if rig.force_length:
            return exp(y / rig.force_length)
        return (rig.gap / (rig.gap - y)) ** fall

    def pull(y, current):
        return strength * current**power * nearer(y) / rig.gap**fall

    def slope(x, u):
        y, v, i, seen = x
        given = bend(asked + u, top, n, creep) - carried
        coil = i if rig.amplifier_time_constant else given
        driven = rest + a * (bend(carried + coil, knee / nearer(y) ** (by_flux / 2), n, creep) - rest)
        force = b * (pull(y, rest) - weight) + pull(y, driven) - pull(y, rest)
        lag = rig.amplifier_time_constant
        return np.array([v, force / rig.mass, (given - i) / lag if lag else 0.0, (y - seen) / rig.sensor_time_constant])

    x, lag, leak, h, found = np.zeros(4), 0.0, 0.0, dt / steps, np.zeros((3, samples))
    wave = e.waveform("reference")[:samples]
    for t in range(samples):
        error = wave[t] - x[3]
        u = g.kp * error + g.kd * (error - lag) / g.td + g.ki * leak
        lag, leak = (error + (old - error) * exp(-dt / time) for old, time in ((lag, g.td), (leak, g.ti)))
        found[:, t] = x[3], u, x[2] if rig.amplifier_time_constant else bend(asked + u, top, n, creep) - carried
        for _ in range(steps):
            k1 = slope(x, u)
            k2 = slope(x + 0.5 * h * k1, u)
            k3 = slope(x + 0.5 * h * k2, u)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + slope(x + h * k3, u))
    return found


CASES = [pytest.param(rig, k, id=f"{name}-{at}") for name, rig in RIGS.items() for at, k in KNEES.items()]
CASES += [
    pytest.param(rig, knee, id=f"{name}-{at}")
    for at, knee in FLUX.items()
    for name, rig in {"ball": BALL, "calibrated ball": RIGS["calibrated ball"], "exponential": LONG}.items()
]


@pytest.mark.slow
@pytest.mark.parametrize(("rig", "knee"), CASES)
def test_the_lane_is_what_the_equations_say(rig, knee):
    e = moved(rig, knee)
    assert structure_of(e).flexible and not structure_of(e).saturating
    expected, plain = (integrated(x, 250) for x in (e, replace(e, effects={})))
    found = simulate_records([e], 4, threads=1)[0][:3, :250]
    change = np.abs(expected - plain).max(axis=1, keepdims=True)
    assert (np.abs(found - expected) < 2e-5 * change).all()
    assert (change > 0.02 * np.abs(plain).max(axis=1, keepdims=True)).all()


@pytest.mark.parametrize(
    ("rig", "name"), [(rig, name) for rig in RIGS.values() for name in KNEES] + [(BALL, "creeping")]
)
def test_the_linear_loop_has_the_slopes_at_the_balance(rig, name):
    values = {"current": inf, "command": inf, "sharpness": 4.0, "creep": 0.0, **CREEPING[name]["saturation"]}
    pulls, carried = through(rig.bias_current, values["current"], values["sharpness"], values["creep"])
    flows, _ = through(carried, values["command"], values["sharpness"], values["creep"])
    frequency = np.geomspace(0.5, 400.0, 20)
    plain, bent = (loop_response(moved(rig, effects), frequency) for effects in ({}, CREEPING[name]))
    assert pulls * flows < 0.9
    np.testing.assert_allclose(bent.plant, pulls * flows * plain.plant, rtol=1e-6)  # the stiffness is the same
    np.testing.assert_allclose(bent.amplifier, flows * plain.amplifier, rtol=1e-6)


SMALL = [pytest.param(rig, KNEES["both"], id=name) for name, rig in RIGS.items()]
SMALL += [pytest.param(rig, FLUX["flux"], id=n) for n, rig in {"flux": RIGS["calibrated ball"], "exp": LONG}.items()]
SMALL += [pytest.param(RIGS["calibrated ball"], FLUX["creeping flux"], id="creeping flux")]


@pytest.mark.slow
@pytest.mark.parametrize(("rig", "knee"), SMALL)
def test_a_small_motion_of_the_lane_is_that_of_the_linear_loop(rig, knee):
    e = replace(moved(rig, knee, 1e-8, (5, 12, 40)), periods=2, transient_periods=12)
    found = simulate_statistics([e]).statistics
    linear = loop_response(e, found.frequency)
    plant = found.mean[0, 0] / found.mean[0, 1]
    np.testing.assert_allclose(plant, linear.plant, rtol=1e-4)


@pytest.mark.parametrize("name", CREEPING)
def test_the_weight_is_carried_at_rest(name):
    e = Experiment(BALL, GAINS, (Excitation("sphs", "reference", 10.0, (1,), 1e-15),), 3, effects=CREEPING[name])
    found = simulate_records([e])[0]
    assert np.abs(found[0]).max() < 1e-11


def test_a_knee_that_cannot_carry_the_weight_lets_it_fall():
    e = replace(moved(BALL, effect("saturation", current=0.85), 1e-6), periods=2)
    assert simulate_statistics([e]).touchdown_time[0] < 0.3
    assert not loop_response(e, np.array([3.0])).plant.any()


@pytest.mark.parametrize("rig", [BALL, FLOATING], ids=["ball", "coil"])
def test_the_flux_density_of_a_single_magnet_is_not_known(rig):
    with pytest.raises(ValueError, match=r"saturation.field has no meaning on rig ball: it needs a pair of magnets"):
        replace(rig, effects=effect("saturation", 1.2))
    assert replace(rig, effects=effect("saturation", inf, current=2.0))


def test_a_flux_that_saturates_needs_iron_that_is_pulled():
    with pytest.raises(
        ValueError, match=r"saturation.distance_share has no meaning on rig ball: it needs a single mag"
    ):
        replace(FLOATING, effects=FLUX["flux"])
