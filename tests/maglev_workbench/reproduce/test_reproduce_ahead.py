"""Eddy currents in laminations, and what is said ahead of future experiments: against own solutions of the physics."""

from dataclasses import replace
from functools import lru_cache
from math import radians, tan

import numpy as np
import pytest
from scipy.linalg import solve_banded

from maglev_env.design.hydraulics import impeller
from maglev_env.rig.rig_file import load_rig
from maglev_env.rotor.parts import Fluid
from maglev_env.rotor.rotor import load_rotor
from maglev_workbench.commands.reproduce.chapters.bearing import future, hydraulics, laminations, passive_force, thrust
from maglev_workbench.commands.reproduce.registry import HOME, chosen

MU_0 = 4e-7 * np.pi
DIFFERS = {
    "laminations": [
        "actuator gain lost at 250 Hz",
        "lag of the force at 250 Hz",
        "steepest flank that a sensor of 150 kHz shows, over the triangle's",
    ],
    "future-work": ["the same at 14,000 rpm"],
    "thrust": ["largest passive force over that thrust, Table 5.4", "the same without flow, Table 5.4"],
}


@lru_cache
def outcome(name):
    return chosen([name])[0].run(0)


@pytest.mark.slow
@pytest.mark.parametrize("name", DIFFERS)
def test_rows_are_whole_and_those_that_differ_say_why(name):
    rows = outcome(name).rows
    assert all(np.isfinite(row.found) for row in rows)
    assert [row.name for row in rows if row.agrees is False] == DIFFERS[name]
    assert all(row.reason for row in rows if row.agrees is False)
    assert {row.again for row in rows} <= {"", *HOME}
    assert outcome(name).plots and outcome(name).notes


@pytest.mark.parametrize("frequency", [250.0, 25e3])
def test_the_flux_in_a_lamination_solves_the_diffusion_equation(frequency):
    """d2H/dx2 = j w mu H / rho by finite differences, H = 1 at both surfaces."""
    n, mu = 2001, 5000.0
    h = laminations.THICKNESS / (n - 1)
    k = 2j * np.pi * frequency * mu * MU_0 / laminations.RESISTIVITY
    bands = np.ones((3, n - 2), complex)
    bands[1] = -2 - k * h**2
    right = np.zeros(n - 2, complex)
    right[[0, -1]] = -1
    field = np.concatenate([[1], solve_banded((1, 1), bands, right), [1]])
    mean = h * (field.sum() - 1) / laminations.THICKNESS
    assert abs(laminations.share(frequency, mu) / mean - 1) < 1e-4


@pytest.mark.slow
def test_the_switched_current_is_that_of_a_lamination_in_time():
    """Voltage sets the mean flux; the field at the surface is found by implicit steps of the diffusion equation."""
    rig, mu, n, steps = load_rig("eframe"), 1000.0, 81, 4000
    x = np.linspace(0, laminations.THICKNESS, n)
    h, dt = x[1], laminations.PERIOD / steps
    d = laminations.RESISTIVITY / (mu * MU_0) * dt / h**2
    bands = np.zeros((3, n))
    bands[0, 2:], bands[1, 1:-1], bands[2, :-2] = -d, 1 + 2 * d, -d
    bands[1, [0, -1]] = 1
    weight = np.full(n, h / x[-1])
    weight[[0, -1]] /= 2
    driven = np.zeros(n)
    driven[[0, -1]] = 1
    by_surface = solve_banded((1, 1), bands, driven)  # the field after a step that only the surface field causes
    field, current = np.zeros(n), []
    wanted, turns, area = 0.0, rig.turns, rig.pole_area
    path, ohm = laminations.E_FRAME_IRON, rig.coil_resistance
    amps = 0.0
    for i in range(6 * steps):
        volts = rig.supply_voltage * (1 if i % steps < steps // 2 else -1)
        wanted += (volts - ohm * amps) / (turns * area) * dt  # mean flux density
        rest = field.copy()
        rest[[0, -1]] = 0
        own = solve_banded((1, 1), bands, rest)
        field = own + by_surface * (wanted / (mu * MU_0) - weight @ own) / (weight @ by_surface)
        amps = (field[0] * path + wanted / MU_0 * 2 * rig.gap) / turns
        current.append(amps)
    last = np.array(current[-steps:])
    time = (np.arange(steps) + 1) * dt
    expected = laminations.switched(rig, mu, time)
    off = last - last.mean() - expected + expected.mean()
    assert np.abs(off).max() < 0.005 * np.ptp(expected)
    eddies = expected - laminations.switched(rig, None, time)
    assert np.abs(eddies - eddies.mean()).max() > 0.02 * np.ptp(expected)  # what the tolerance must tell


def grown(rotor, speed, mass, damping, fine, seconds=0.3):
    """Growth (1/s) of the translation x + i y in a fluid that turns: the equations in its frame, step by step."""
    axis, gains = rotor.axis, rotor.gains["translation"]
    dt = 1 / axis.control_rate / fine
    turn, body = speed / 2, rotor.body.mass
    q, v, probe, amplifier, filtered, last = 1e-6, 0j, 1e-6, 0j, 0j, 1e-6
    size = []
    keep = np.exp(-fine * dt / gains.td)
    for _ in range(round(seconds * axis.control_rate)):
        filtered, last = keep * filtered - probe - last, -probe
        command = -gains.kp * probe + gains.kd / gains.td * filtered
        for _ in range(fine):
            force = axis.actuator_gain * amplifier - axis.negative_stiffness * q
            frame = mass * (2j * turn * v + turn**2 * q) - damping * (v - 1j * turn * q)
            v = v + dt * (force + frame) / (body + mass)
            q = q + dt * v
            probe = probe + (q - probe) * -np.expm1(-dt / axis.sensor_time_constant)
            amplifier = amplifier + (command - amplifier) * -np.expm1(-dt / axis.amplifier_time_constant)
        size.append(abs(q))
    tail = np.log(size[len(size) // 2 :])
    return float(np.polyfit(np.arange(tail.size) / axis.control_rate, tail, 1)[0])


@pytest.mark.slow
def test_the_whirl_in_water_grows_as_an_integration_in_time():
    rotor = load_rotor("pump")
    rotor = replace(rotor, gains={name: replace(g, ki=0.0) for name, g in rotor.gains.items()})
    mass, damping = future.fluid(rotor, *future.WATER)
    speed = future.TOP * np.pi / 30
    rough, fine = (grown(rotor, speed, mass, damping, fine=steps) for steps in (8, 16))
    # Steps of first order: what the half of them changes, once more.
    assert future.right_most(rotor, future.TOP, mass, damping) == pytest.approx(2 * fine - rough, rel=0.005)


def test_a_fluid_that_does_not_turn_is_the_rotor_models_own(monkeypatch):
    monkeypatch.setattr(future, "SWIRL", 0.0)
    rotor = load_rotor("pump")
    arm = future.LENGTH / np.sqrt(12)  # planes at which dampers turn as the fluid along the rotor does
    rotor = replace(rotor, planes=replace(rotor.planes, magnets=(-arm, arm)))
    wet = replace(rotor, fluid=Fluid(0.3, 0.3 * arm**2, 0.0, 10.0))
    assert future.right_most(rotor, 5000.0, 0.3, 20.0) == pytest.approx(future.right_most(wet, 5000.0), rel=1e-6)


def test_the_pump_curve_is_that_of_its_velocity_triangles():
    pump, (beta, alpha) = hydraulics.PUMP, hydraulics.PRINTED_ANGLES
    blades = impeller(pump, beta, alpha)
    for litres in (1.0, 5.0, 8.0):
        axial = litres / 6e4 / (5 / 6 * np.pi * (7.4e-3**2 - 2.5e-3**2))
        u = blades.speed * 4.95e-3
        swirl = axial * tan(blades.straightener_angle)
        euler = 1003 * u * (u - swirl)
        missed = u - swirl - axial * tan(radians(77)), axial * tan(radians(82)) - u
        ideal, lossy = (future.pump_curve(pump, blades, np.array([litres]), how)[0] for how in (False, True))
        assert ideal == pytest.approx(euler, rel=1e-9)
        assert lossy == pytest.approx(euler - 1003 / 2 * (missed[0] ** 2 + missed[1] ** 2), rel=1e-9, abs=1e-6)


@pytest.mark.slow
def test_the_passive_force_draws_back_and_begins_with_the_stiffness_of_the_flux_map():
    rotor = load_rotor("pump")
    z, force = future.axial_pull(rotor)
    assert z[0] == 0 and force[0] == pytest.approx(0, abs=1e-9) and (force[1:] > 0).all()
    (face,) = [r.found for r in chosen(["flux-map"])[0].run(0).rows if r.name == "axial stiffness of one face"]
    assert force[1] / z[1] == pytest.approx(1e3 * face * future.FACES, rel=0.15)
    assert passive_force.Passive(z, force).stiffness == pytest.approx(1e3 * face * future.FACES, rel=0.06)


def test_a_sensor_shows_the_current_late_and_without_its_corners():
    """The lag of first order, by steps over many periods."""
    rig, steps, band = load_rig("eframe"), 4000, 150e3
    time = np.arange(steps) * laminations.PERIOD / steps
    current = laminations.switched(rig, 1000.0, time)
    keep, read, shown = np.exp(-2 * np.pi * band * time[1]), 0.0, np.zeros(steps)
    for _ in range(3):
        for i in range(steps):
            read = keep * read + (1 - keep) * (current[i] + current[i - 1]) / 2
            shown[i] = read
    assert np.abs(shown - laminations.switched(rig, 1000.0, time, band)).max() < 2e-3 * np.ptp(current)
    slope = np.diff(shown[: steps // 2 + 1 : 10])[:200].max() / (np.ptp(laminations.switched(rig, None, time)) / 200)
    assert slope == pytest.approx(laminations.steepest(rig, 1000.0, band), rel=0.02)


@pytest.mark.parametrize("litres", [0.0, 5.0, 9.0])
def test_the_static_pressure_is_what_the_impeller_adds_less_the_swirl_that_it_makes(litres):
    """Energy: Euler's rise is of the total pressure, and the axial velocity does not change."""
    pump = replace(hydraulics.PUMP, outlet_angle=radians(20))
    blades = impeller(pump, *hydraulics.PRINTED_ANGLES)
    axial, u = pump.axial_velocity * litres / 5, blades.blade_velocity
    before, after = axial * tan(blades.straightener_angle), u - axial * tan(radians(20))
    total = future.pump_curve(pump, blades, np.array([litres]), lossy=False)[0]
    expected = total - pump.density / 2 * (after**2 - before**2)
    assert thrust.static_rise(pump, blades, np.array([litres]))[0] == pytest.approx(expected, rel=1e-9)


def test_a_load_is_balanced_by_the_passive_force_or_not_held():
    z = np.linspace(0.0, 1.4e-3, 15)
    pull = 4.0 * np.sin(z / 0.9e-3)  # largest at 1.41 mm, beyond the last point
    passive = passive_force.Passive(z, pull, 2000.0)
    scale = 2000.0 / (4.0 / 0.9e-3)
    assert passive.most == pytest.approx(4.0 * scale, rel=1e-3)
    place, share = passive.at(1.0)
    assert place == pytest.approx(0.9e-3 * np.arcsin(1.0 / (4.0 * scale)), rel=1e-3)
    assert share == pytest.approx(np.cos(place / 0.9e-3), rel=1e-3)
    assert np.isnan(passive.at(1.01 * passive.most)).all()
