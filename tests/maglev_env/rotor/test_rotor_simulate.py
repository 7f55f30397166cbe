"""The rotor's kernel against a tight integrator, conserved energy, and the linear model."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.linear import at_planes, control_matrices, probe_readings, unbalance_response
from maglev_env.rotor.parts import Runout, Touchdown, Unbalance
from maglev_env.rotor.rotor import CONTROLS, Rotor, load_rotor
from maglev_env.rotor.run_up import run_up
from maglev_env.rotor.simulate import spin

PUMP = load_rotor("pump")
QUIET = replace(PUMP.axis, adc_bits=0, dac_bits=0, noise=replace(PUMP.axis.noise, displacement=0.0))
IDEAL = replace(PUMP, axis=QUIET)


def reference(rotor: Rotor, speed: float, samples: int, start: np.ndarray) -> np.ndarray:
    """The same loop by scipy's integrator at tight tolerance: state (samples + 1, 10) at the control samples."""
    axis, law, dt = rotor.axis, force_law(rotor.axis), 1 / rotor.axis.control_rate
    magnets, probes = at_planes(*rotor.planes.magnets), at_planes(*rotor.planes.probes)
    into, out = control_matrices(rotor)
    gains = [g for g in rotor.gains.values() for _ in range(2)]
    kp, ki, kd = (np.array([getattr(g, name) for g in gains]) for name in ("kp", "ki", "kd"))
    td, ti = np.array([g.td for g in gains]), np.array([g.ti for g in gains])
    m, inertia, polar = rotor.moving_mass, rotor.moving_inertia, rotor.body.polar_inertia
    u, weight = rotor.unbalance, np.array(rotor.gravity) * rotor.body.mass
    turning = np.array(rotor.runout.amplitude) * np.exp(1j * np.radians(rotor.runout.phase))

    def rates(t: float, s: np.ndarray, command: np.ndarray) -> np.ndarray:
        q, v, seen, current = s[:4], s[5:9], s[10:14], s[14:]
        at, moving = magnets @ q, magnets @ v
        f = 0.5 * force(law, at, current) - rotor.fluid.stiffness * at - rotor.fluid.damping * moving
        g = magnets.T @ f
        turn, late = np.exp(1j * speed * t), np.exp(1j * (speed * t + np.radians(u.angle)))
        a = np.array(
            [
                (g[0] + u.static * speed**2 * turn.real + weight[0]) / m,
                (g[1] + u.couple * speed**2 * late.real - polar * speed * v[3]) / inertia,
                (g[2] + u.static * speed**2 * turn.imag + weight[1]) / m,
                (g[3] + u.couple * speed**2 * late.imag + polar * speed * v[1]) / inertia,
            ]
        )
        z = (-2 * rotor.axial.stiffness * s[4] - rotor.axial.damping * s[9] + weight[2]) / m
        runout = np.array([part for one in turning * turn for part in (one.real, one.imag)])
        dots = (probes @ q + runout - seen) / axis.sensor_time_constant
        return np.concatenate([v, [s[9]], a, [z], dots, (command - current) / axis.amplifier_time_constant])

    s = np.concatenate([start, np.zeros(8)])
    d, xi, found = np.zeros(4), np.zeros(4), [s[:10]]
    for k in range(samples):
        e = -into @ s[10:14]
        command = out @ (kp * e + kd * (e - d) / td + ki * xi)
        d, xi = e + (d - e) * np.exp(-dt / td), e + (xi - e) * np.exp(-dt / ti)
        s = solve_ivp(
            rates, (k * dt, (k + 1) * dt), s, "DOP853", rtol=1e-12, atol=1e-18, args=(command,), max_step=dt / 4
        ).y[:, -1]
        found.append(s[:10])
    return np.array(found)


START = np.array([20e-6, 4e-4, -15e-6, -3e-4, 30e-6, 1e-3, 0.02, -2e-3, 0.05, 1e-3])


@pytest.mark.slow
@pytest.mark.parametrize("names", CONTROLS)
def test_the_kernel_is_the_tight_integrator(names: tuple[str, str]) -> None:
    one, other = PUMP.gains.values()
    gains = dict(zip(names, (one, replace(other, kp=9000.0, kd=4.5)), strict=True))
    rotor = replace(
        IDEAL, gains=gains, unbalance=Unbalance(3e-7, 8e-8, 50.0), runout=Runout((1e-6, 2e-6), (10.0, 80.0))
    )
    rotor = replace(
        rotor, fluid=replace(rotor.fluid, added_mass=5e-3, added_inertia=1e-6, damping=2.0, stiffness=300.0)
    )
    n = 60
    expected = reference(rotor, 12_000 * np.pi / 30, n, START)
    scale = np.sqrt((expected**2).mean(axis=0))
    off = {s: spin([Run(rotor, 12_000)], n, start=START, substeps=s).state[0] - expected[-1] for s in (1, 2)}
    assert (abs(off[1]) < 1e-6 * scale).all()
    assert (abs(off[2]) < 1e-7 * scale).all()


def unsupported(rotor: Rotor) -> Rotor:
    """Without magnets, control, weight and unbalance."""
    still = replace(QUIET, actuator_gain=1e-6, negative_stiffness=-1e-9)
    off = {name: replace(g, kp=0.0, ki=0.0, kd=0.0) for name, g in PUMP.gains.items()}
    return replace(rotor, axis=still, gains=off, unbalance=Unbalance(), runout=Runout(), gravity=(0.0, 0.0, 0.0))


@pytest.mark.parametrize("stiffness", [2e6, 2e8])
def test_however_stiff_a_bearing_is_a_blow_returns_with_its_restitution(stiffness: float) -> None:
    touch = Touchdown(stiffness=stiffness, friction=0.0, speed=0.4)
    start = np.zeros(10)
    start[0], start[5] = QUIET.clearance - 1e-6, touch.speed
    found = spin([Run(unsupported(replace(IDEAL, touchdown=touch)))], 40, start=start)
    assert found.state[0, 5] == pytest.approx(-touch.restitution * touch.speed, rel=0.02)


@pytest.mark.parametrize(("stiffness", "off"), [(2e6, 0.12), (2e7, 0.01), (2e8, 0.01)])
def test_friction_takes_as_much_as_it_gives_until_the_rotor_rolls_around(stiffness: float, off: float) -> None:
    """It drives a rotor as a belt drives what is put on it, up to its own speed: half of its work is lost."""
    rotor = unsupported(replace(IDEAL, touchdown=Touchdown(stiffness=stiffness)))
    surface = 1000 * np.pi / 30 * rotor.body.radius
    start = np.zeros(10)
    start[0], start[5] = QUIET.clearance - 1e-6, 0.2 * surface
    found = spin([Run(rotor, 1000)], 4000, start=start)
    (x, _, y, _, _, vx, _, vy), size = found.state[0, :8], np.hypot(*found.state[0, [0, 2]])
    assert (y * vx - x * vy) / size == pytest.approx(surface, rel=2e-3)
    assert found.rubbed[0] == pytest.approx(rotor.body.mass * surface**2 / 2, rel=off)


def test_rotors_of_one_batch_have_the_steps_that_each_needs() -> None:
    start = np.zeros(10)
    start[0], start[5] = QUIET.clearance - 1e-6, 0.4
    soft, stiff = (unsupported(replace(IDEAL, touchdown=Touchdown(stiffness=k))) for k in (2e6, 2e8))
    runs = [Run(rotor, 1000) for rotor in (soft, stiff, stiff, soft)]
    beside, alone = spin(runs, 40, start=start), [spin([run], 40, start=start).state[0] for run in runs]
    assert np.array_equal(beside.state, alone) and not np.array_equal(alone[0], alone[1])
    with pytest.raises(ValueError, match=r"rotor pump: .* integration steps per control sample"):
        spin([Run(replace(IDEAL, fluid=replace(IDEAL.fluid, damping=1e7)))], 1)


@pytest.mark.parametrize("restitution", [0.3, 0.6, 0.95])
def test_a_blow_returns_with_the_restitution_and_friction_turns_it(restitution: float) -> None:
    touch = Touchdown(stiffness=2e8, restitution=restitution, friction=0.004, speed=0.4)
    rotor = unsupported(replace(IDEAL, touchdown=touch))
    start = np.zeros(10)
    start[0], start[5] = QUIET.clearance - 1e-6, touch.speed
    found = spin([Run(rotor, 14_000)], 20, start=start, substeps=16)
    # Both planes are hit: the normal impulse is m v (1 + r), friction's so much of it, against the turning surface.
    along = touch.speed * (1 + restitution)
    assert found.state[0, 5] == pytest.approx(-restitution * touch.speed, rel=2e-3)
    assert found.state[0, 7] == pytest.approx(-0.004 * along, rel=0.03)  # round, not flat
    slip = 14_000 * np.pi / 30 * rotor.body.radius - 0.5 * 0.004 * along
    assert found.rubbed[0] == pytest.approx(0.004 * rotor.body.mass * along * slip, rel=2e-3)
    # Undamped, the force would be v sqrt(k m) of a spring of both planes, half in each.
    undamped = touch.speed * np.sqrt(2 * touch.stiffness * rotor.body.mass) / 2
    assert 0.8 < found.contact[0, 0] / undamped < 1.3
    assert found.contact[0, 0] == found.contact[0, 1] and found.contact[0, 2] == 0
    assert 0 < found.first_contact[0, 0] < 2 * 1e-6 / touch.speed + 1 / QUIET.control_rate


def test_the_axial_stop_holds_what_the_passive_force_does_not() -> None:
    rotor = unsupported(IDEAL)
    start = np.zeros(10)
    start[9] = 0.5
    found = spin([Run(rotor)], 400, start=start, substeps=4)
    assert found.contact[0, 2] > 10 and np.isfinite(found.first_contact[0, 2])
    assert abs(found.channels[0, 8]).max() < 1.2 * rotor.axial.clearance


def test_once_per_turn_is_the_linear_models_however_many_turns_are_measured() -> None:
    """At a small orbit; of 125 rpm half a turn fits into the usual time, and a fifth of the amplitude had been seen."""
    small = replace(IDEAL, unbalance=Unbalance(4.5e-8, 2e-9, 90.0), gravity=(0.0, 0.0, 0.0))
    rpm = np.array([10.0, 40.0, 125.0, 333.0, -410.0, 1130.0, 9990.0])
    speed = rpm * np.pi / 30
    expected = abs(probe_readings(small, unbalance_response(small, speed), speed))[:, ::2]
    found = run_up([small], rpm)
    assert found.once[0, :, :2] == pytest.approx(expected, rel=0.01)
    assert found.peak[0, :3] == pytest.approx(expected[:3], rel=0.01)
    # A turn of an hour is not waited for: what is seen is how much it has moved.
    assert (run_up([small], np.array([1 / 60])).once[0, 0, :2] < 0.1 * expected[0]).all()


def test_energy_of_the_free_rotor_is_conserved() -> None:
    axial = replace(PUMP.axial, damping=0.0)
    rotor = replace(unsupported(IDEAL), fluid=replace(PUMP.fluid, stiffness=16_500.0), axial=axial)
    runs = [Run(rotor, rpm) for rpm in (0.0, 14_000.0)]

    def energy(s: np.ndarray) -> np.ndarray:
        inertia = np.array([rotor.body.mass, rotor.body.transverse_inertia] * 2 + [rotor.body.mass])
        at = at_planes(*rotor.planes.magnets) @ s[:, :4].T
        kinetic = (inertia * s[:, 5:] ** 2).sum(axis=1) / 2
        return kinetic + 16_500 * (at**2).sum(axis=0) / 2 + rotor.axial.stiffness * s[:, 4] ** 2

    start = energy(START[None])
    assert energy(spin(runs, 4000, start=START).state) == pytest.approx(np.repeat(start, 2), rel=1e-6)


def test_conical_whirl_does_no_work_but_turns() -> None:
    """Without any support the tilt precesses at polar / transverse inertia times the speed."""
    rotor = unsupported(IDEAL)
    start = np.zeros(10)
    start[6] = 1e-3  # rad/s about one axis
    n = 2000
    found = spin([Run(rotor, 14_000)], n, start=start).state[0]
    body = rotor.body
    angle = body.polar_inertia / body.transverse_inertia * 14_000 * np.pi / 30 * n / QUIET.control_rate
    assert found[[6, 8]] == pytest.approx(1e-3 * np.array([np.cos(angle), np.sin(angle)]), abs=1e-9)


def test_small_unbalance_response_is_the_linear_model() -> None:
    rotor = replace(IDEAL, unbalance=Unbalance(2e-9, 1e-9, 70.0), runout=Runout((2e-8, 1e-8), (0.0, 40.0)))
    rotor = replace(rotor, gravity=(0.0, 0.0, 0.0))
    rpm = np.arange(500.0, 14_001, 1500)
    n = 2400  # whole turns at all of them
    found = spin([Run(rotor, v) for v in rpm], n, settle=24_000)
    t = (24_000 + np.arange(n)) / rotor.axis.control_rate
    turned = np.exp(-1j * np.outer(rpm * np.pi / 30, t))
    amplitude = 2 * (found.channels[:, :4] * turned[:, None]).mean(axis=-1)
    speeds = rpm * np.pi / 30
    expected = unbalance_response(rotor, speeds) @ at_planes(*rotor.planes.probes).T
    phasor = np.array(rotor.runout.amplitude) * np.exp(1j * np.radians(rotor.runout.phase))
    expected += np.array([p * turn for p in phasor for turn in (1.0, -1j)])
    expected /= (1 + 1j * speeds * rotor.axis.sensor_time_constant)[:, None]
    assert (abs(amplitude - expected) < 1e-4 * abs(expected)).all()
