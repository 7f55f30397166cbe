"""The motor against the sum over its conductors, closed forms of spinning up, and conservation of energy."""

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from maglev_env.design.motor import Motor

MOTOR = Motor(
    turns=21,
    radius=9e-3,
    length=20e-3,
    flux_density=0.3,
    pole_pairs=4,
    winding_resistance=0.8,
    current_limit=3.0,
    supply_voltage=24.0,
)
DRAGGED = replace(MOTOR, viscous_drag=1e-6, quadratic_drag=2e-9)
INERTIA = 5e-6
# Where D's eq 3.5 has the coil sides of each phase (in 1/24 pi), with their signs + - + -.
SIDES = {0: (-3, 3, 21, 27), 2: (5, 11, 29, 35), 4: (13, 19, 37, 43)}  # key: phase in pi/3


def conductors():
    """Angle (12,), sign (12,) and phase (12,) in rad of every coil side."""
    angle = np.array([a for sides in SIDES.values() for a in sides]) * pi / 24
    return angle, np.tile([1.0, -1.0], 6), np.repeat(list(SIDES), 4) * pi / 3


def field(angle, electrical):
    return -MOTOR.flux_density * np.sin(electrical - 4 * angle)  # eq 3.3


def test_torque_is_the_sum_over_the_conductors_at_every_position():
    angle, sign, phase = conductors()
    for shift in (0.0, 0.4, 1.3, 2.9):
        for electrical in np.linspace(0, 2 * pi, 37):
            current = 2.5 * np.cos(electrical + phase + shift)  # eq 3.4
            force = MOTOR.turns * MOTOR.length * sign * current * field(angle, electrical)
            # the rotor takes the reaction to the force on the conductors
            assert -MOTOR.radius * force.sum() == pytest.approx(MOTOR.torque(2.5, shift), abs=1e-12)


def test_back_emf_is_that_of_the_conductors():
    """Peak over a turn of N B l v along one phase's coil sides; and power is conserved."""
    angle, sign, _ = conductors()
    electrical = np.linspace(0, 2 * pi, 721)
    along = sign[:4] * field(angle[:4], electrical[:, None])
    emf = MOTOR.turns * MOTOR.length * MOTOR.radius * 700.0 * along.sum(axis=1)
    assert MOTOR.back_emf(700.0) == pytest.approx(np.abs(emf).max(), rel=1e-6)
    assert 1.5 * MOTOR.back_emf(700.0) * 1.1 == pytest.approx(MOTOR.torque(1.1) * 700.0)
    assert MOTOR.electrical_frequency(2 * pi * 100) == pytest.approx(400.0)


def test_without_drag_the_speed_rises_linearly_to_where_the_supply_limits_it():
    corner = (24 / sqrt(3) - 0.8 * 3.0) / MOTOR.back_emf(1.0)
    rpm = 0.9 * corner * 30 / pi
    assert MOTOR.spin_up_time(rpm, INERTIA) == pytest.approx(INERTIA * 0.9 * corner / MOTOR.torque(3.0), rel=1e-9)
    assert MOTOR.greatest_current(0.9 * corner) == 3.0
    beyond = 1.05 * corner
    assert 0 < MOTOR.greatest_current(beyond) < 3.0


def test_beyond_the_corner_the_speed_nears_no_load_exponentially():
    """With no current limit to speak of: J w' = kt (V - ke w) / R."""
    free = replace(MOTOR, current_limit=1e3)
    no_load, rate = free.top_speed(), free.torque_constant * free.back_emf(1.0) / 0.8 / INERTIA
    assert no_load == pytest.approx(24 / sqrt(3) / free.back_emf(1.0))
    assert free.spin_up_time(0.95 * no_load * 30 / pi, INERTIA) == pytest.approx(-np.log(0.05) / rate, rel=1e-8)


def test_spin_up_and_energy_with_drag():
    """ODE at tight tolerance: the same time, and electrical energy = kinetic + copper + drag."""
    top, speed = DRAGGED.top_speed(), 0.97 * DRAGGED.top_speed()
    assert DRAGGED.greatest_torque(top) == pytest.approx(DRAGGED.drag_torque(top), rel=1e-9)

    def rates(_, state):
        w = state[0]
        current, drag = DRAGGED.greatest_current(w), 1e-6 * w + 2e-9 * w * w
        voltage = 0.8 * current + DRAGGED.back_emf(w)
        torque = 6 * 21 * 9e-3 * 20e-3 * 0.3 * current
        return [(torque - drag) / INERTIA, 1.5 * voltage * current, 1.5 * 0.8 * current**2, drag * w]

    def arrived(_, state):
        return state[0] - speed

    arrived.terminal = True
    run = solve_ivp(rates, (0, 100), np.zeros(4), events=arrived, rtol=1e-10, atol=1e-12, max_step=0.01)
    assert DRAGGED.spin_up_time(speed * 30 / pi, INERTIA) == pytest.approx(run.t[-1], rel=1e-6)
    w, electrical, copper, dragged = run.y[:, -1]
    assert electrical == pytest.approx(INERTIA * w**2 / 2 + copper + dragged, rel=1e-8)
    assert dragged > 0.05 * electrical


def test_holding_a_speed():
    current = DRAGGED.current(1000.0)
    assert DRAGGED.torque(current) == pytest.approx(1e-6 * 1000 + 2e-9 * 1e6)
    input_power = 1.5 * current * (0.8 * current + DRAGGED.back_emf(1000.0))
    assert input_power == pytest.approx(DRAGGED.copper_loss(1000.0) + 3e-3 * 1000.0)


def test_a_speed_out_of_reach_names_what_limits_the_torque():
    top = DRAGGED.top_speed() * 30 / pi
    for ask in (lambda m: m.spin_up_time(1.01 * top, INERTIA), lambda m: m.current(1.01 * top * pi / 30)):
        with pytest.raises(
            ValueError, match=r"supply of 24 V leaves .* N m against a drag of .* N m; the top speed is"
        ):
            ask(DRAGGED)
    starved = replace(DRAGGED, current_limit=0.02)
    with pytest.raises(ValueError, match=r"current limit of 0.02 A leaves 0.0001361 N m"):
        starved.current(0.9 * DRAGGED.top_speed())
    with pytest.raises(ValueError, match="top speed"):
        MOTOR.current(1.01 * MOTOR.top_speed())


def test_a_motor_that_cannot_be_is_refused():
    with pytest.raises(ValueError, match="winding_resistance"):
        replace(MOTOR, winding_resistance=0.0)
    with pytest.raises(ValueError, match="viscous_drag"):
        replace(MOTOR, viscous_drag=-1.0)
    with pytest.raises(ValueError, match="pole_pairs"):
        replace(MOTOR, pole_pairs=1.5)
    with pytest.raises(ValueError, match="inertia"):
        MOTOR.spin_up_time(100.0, 0.0)


def test_without_drag_every_motor_reaches_its_no_load_speed():
    """Rounding may leave a torque of 1e-17 N m there, or the opposite."""
    rng, varied = np.random.default_rng(0), ("radius", "length", "flux_density", "winding_resistance", "supply_voltage")
    for _ in range(200):
        free = replace(MOTOR, **{name: getattr(MOTOR, name) * float(rng.uniform(0.3, 3.0)) for name in varied})
        assert free.top_speed() == pytest.approx(free.phase_voltage / free.back_emf(1.0))
