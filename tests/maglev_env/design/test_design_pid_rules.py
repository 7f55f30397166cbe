"""Gain rules against the roots of the loop's characteristic polynomial, built here without the module's."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.design.pid_rules import (
    ControlledAxis,
    characteristic_polynomial,
    gains_for,
    is_stable,
    rightmost_pole,
    stability_conditions,
)
from maglev_env.loop.gains import Gains

AXIS = ControlledAxis(mass=0.08012, negative_stiffness=-12.5e3, actuator_gain=5.7, amplifier_time_constant=1e-4)
TABLE = Gains(kp=8000.0, ki=2000.0, kd=5.2, td=1e-4, ti=0.0318)


def loop(s, axis, gains, leaky=False):
    """The left side of D's eq 3.24 with 3.21 or 3.27 and 3.22, as fractions."""
    integrator = gains.ki / (gains.ti * s + 1) if leaky else gains.ki / s
    controller = gains.kp + gains.kd * s / (1 + s * gains.td) + integrator
    amplifier = 1 / (1 + s * axis.amplifier_time_constant)
    return axis.mass * s**2 + axis.negative_stiffness + axis.actuator_gain * axis.loop_gain * controller * amplifier


def drawn(rng):
    """An axis and gains about the border of stability."""
    axis = ControlledAxis(
        mass=10 ** rng.uniform(-2, 1),
        negative_stiffness=-(10 ** rng.uniform(3, 5)),
        actuator_gain=10 ** rng.uniform(0, 2),
        amplifier_time_constant=10 ** rng.uniform(-5, -3),
        loop_gain=10 ** rng.uniform(-1, 1),
    )
    kp = axis.current_per_displacement / axis.loop_gain * rng.uniform(0.3, 6)
    rate = np.sqrt(-axis.negative_stiffness / axis.mass)
    td, kd = 10 ** rng.uniform(-5, -3), kp / rate * 10 ** rng.uniform(-2, 1)
    return axis, Gains(kp, kp * rate * 10 ** rng.uniform(-2, 1), kd, td, 10 ** rng.uniform(-2, 0))


@pytest.mark.parametrize("leaky", [False, True])
def test_the_polynomial_is_the_loop_times_its_denominators(leaky):
    rng = np.random.default_rng(1)
    for _ in range(50):
        axis, gains = drawn(rng)
        s = rng.normal(size=8) * 1e3 + 1j * rng.normal(size=8) * 1e3
        denominators = (1 + s * gains.td) * (1 + s * axis.amplifier_time_constant)
        denominators = denominators * (gains.ti * s + 1 if leaky else s)
        found = np.polyval(characteristic_polynomial(axis, gains, leaky), s)
        np.testing.assert_allclose(found, loop(s, axis, gains, leaky) * denominators, rtol=1e-9)


def test_routh_agrees_with_the_roots():
    rng, stable = np.random.default_rng(2), 0
    for _ in range(3000):
        p = rng.uniform(0.05, 1, rng.integers(2, 8)) * rng.choice([-1, 1])
        assert is_stable(p) == bool((np.roots(p).real < 0).all())
        stable += is_stable(p)
    assert 500 < stable < 2500
    assert not is_stable([1, 0, 1]) and not is_stable([1, 1, 1, 1])
    for bad in ([0.0, 1.0], [1.0], [1.0, np.nan]):
        with pytest.raises(ValueError, match="coefficients"):
            is_stable(bad)


def test_the_conditions_are_the_signs_of_the_coefficients_and_no_more():
    rng, met, stable = np.random.default_rng(3), 0, 0
    for _ in range(1500):
        axis, gains = drawn(rng)
        p = characteristic_polynomial(axis, gains)
        conditions = stability_conditions(axis, gains)
        # m T_a T_d and m (T_a + T_d) are above 0 always
        assert [c.met for c in conditions] == (p[2:] > 0).tolist()
        by_roots = rightmost_pole(axis, gains) < 0
        assert is_stable(p) == by_roots
        met += all(c.met for c in conditions)
        stable += by_roots
        assert all(c.met for c in conditions) or not by_roots
    # necessary but not sufficient: many loops meet them all and are unstable
    assert 150 < stable < 0.9 * met


def test_the_printed_condition_passes_what_the_corrected_one_refuses():
    """I_0 / g_0 instead of |k_yy| / k_yi: gains that cannot hold the rotor against its magnets pass."""
    weak = replace(TABLE, kp=1500.0)
    printed = stability_conditions(AXIS, weak, current_per_displacement=0.2 / 0.35e-3)
    assert all(c.met for c in printed)
    assert [c.met for c in stability_conditions(AXIS, weak)] == [True, True, False, True]
    assert rightmost_pole(AXIS, weak) > 0


def test_the_two_ratios_agree_without_a_permanent_magnet():
    """An electromagnet pair f = c ((I0 + i)^2 / (g - y)^2 - (I0 - i)^2 / (g + y)^2), differentiated numerically."""

    def force(y, i, bias=0.3, gap=1e-3):
        return 1e-6 * ((bias + i) ** 2 / (gap - y) ** 2 - (bias - i) ** 2 / (gap + y) ** 2)

    gain, stiffness = (force(0, 1e-6) - force(0, -1e-6)) / 2e-6, -(force(1e-9, 0) - force(-1e-9, 0)) / 2e-9
    axis = ControlledAxis(1.0, stiffness, gain, 1e-4)
    assert axis.current_per_displacement == pytest.approx(0.3 / 1e-3, rel=1e-6)


def test_the_gains_of_the_table():
    assert rightmost_pole(AXIS, TABLE, leaky=True) == pytest.approx(-42.6, abs=0.1)
    weak = replace(AXIS, actuator_gain=1.281)
    assert rightmost_pole(weak, TABLE, leaky=True) == pytest.approx(115.8, abs=0.1)
    assert not stability_conditions(weak, TABLE)[2].met


def test_gains_make_the_wanted_stiffness_and_damping():
    """With hardly any lag the poles are those of m s^2 + c s + k."""
    quick = replace(AXIS, amplifier_time_constant=1e-8, loop_gain=0.5)
    kp, kd = gains_for(20e3, 25.0, quick)
    poles = np.roots(characteristic_polynomial(quick, Gains(kp, 1e-6, kd, td=1e-8)))
    wanted = np.roots([quick.mass, 25.0, 20e3])
    for pole in wanted:
        assert np.abs(poles - pole).min() < 1e-3 * abs(pole)
    with pytest.raises(ValueError, match="damping"):
        gains_for(20e3, 0.0, AXIS)


def test_an_axis_of_the_wrong_sign_is_refused():
    with pytest.raises(ValueError, match="negative_stiffness"):
        replace(AXIS, negative_stiffness=12.5e3)
    with pytest.raises(ValueError, match="mass"):
        replace(AXIS, mass=-1.0)
