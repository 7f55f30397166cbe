"""Lanes of the rotor kernel: rotors at their speeds as blocks of its rows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, log2, sqrt

import numpy as np

from maglev_env.kernel.exact import actuator_rows, sensor_rows
from maglev_env.lane_values import LaneValues
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.rig.rig import Rig
from maglev_env.rotor import rows as r
from maglev_env.rotor.linear import LEAST_LAG, at_planes, control_matrices, controllers, rejection_gain
from maglev_env.rotor.rotor import Rotor
from maglev_lanes.layout import LANES, LaneRows
from selfsense.kernel_rows import GAP, REST_CURRENT
from selfsense.sensor import sensor_rows as sensor_rows_of

REACH = 0.98  # of the gap: nearer to a pole its field is no law's any more
MOST_TURN, MOST_DECAY = 0.6, 1.5  # rad and time constants that a step may hold of what swings and of what decays
MOST_STEPS = 256
IDEAL = 48  # bits of a converter that the rig calls ideal


@dataclass(frozen=True)
class Run:
    """A rotor spinning at a speed (rpm; negative: the other way) under its own gains; its noise comes from seed."""

    rotor: Rotor
    speed_rpm: float = 0.0
    seed: int | tuple[int, ...] = 0

    @property
    def speed(self) -> float:
        """rad/s."""
        return self.speed_rpm * np.pi / 30


def enough_substeps(rotor: Rotor) -> int:
    """Integration steps per control sample that follow the fastest of touchdown, fluid and support, a power of two.

    Raises:
        ValueError: More than MOST_STEPS.
    """
    axial, fluid, touch = rotor.axial, rotor.fluid, rotor.touchdown
    pushed, lifted = _pushed(rotor), 1 / rotor.moving_mass
    radial, along = touch.stiffness + abs(fluid.stiffness), touch.stiffness + 2 * axial.stiffness
    turn = sqrt(max(radial * pushed, along * lifted))
    # An impact at the touchdown's speed is damped at this multiple of the rate at which the contact swings.
    rate = touch.damping * touch.speed * turn + max(fluid.damping * pushed, axial.damping * lifted)
    steps = max(turn / MOST_TURN, rate / MOST_DECAY, 1.0) / rotor.axis.control_rate
    if steps > MOST_STEPS:
        raise ValueError(
            f"rotor {rotor.name}: its [touchdown], [fluid] or [axial] is so stiff or damped for its mass that "
            f"{steps:.3g} integration steps per control sample were needed, {MOST_STEPS} at most; lower it"
        )
    return 2 ** max(0, ceil(log2(steps)))


def _pushed(rotor: Rotor) -> float:
    """Largest acceleration per force, 1/kg, of the surface at a magnet plane, where both planes are pushed."""
    at = at_planes(*rotor.planes.magnets)[::2, :2]
    return float(np.linalg.norm(at / np.sqrt([rotor.moving_mass, rotor.moving_inertia]), 2) ** 2)


def block(runs: Sequence[Run], substeps: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Rows (ROWS, LANES) at the start, rotors at rest in the centre, and noise seeds (8, LANES) of probes and coils.

    On self-sensing, which all or none of the runs are on, there are SENSING_ROWS. The last of at most LANES runs fills
    the rest.
    """
    chains = {id(axis): _chains(axis, substeps) for axis in (run.rotor.axis for run in runs)}
    columns = [_column(run, substeps, *chains[id(run.rotor.axis)]) for run in runs]
    seeds = [np.random.SeedSequence(run.seed).generate_state(8, np.uint64) for run in runs]
    pad = np.minimum(np.arange(LANES), len(runs) - 1)
    return np.ascontiguousarray(np.array(columns).T[:, pad]), np.ascontiguousarray(np.array(seeds).T[:, pad])


def _chains(axis: Rig, substeps: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows CHAIN and DECAYS of an axis."""
    step, lagging = np.array([1 / (axis.control_rate * substeps)]), LaneValues((_lagging(axis),), ({},))
    nodes = actuator_rows(lagging, step, np.zeros(1)).reshape(5, 4, 1)[:, 0]
    return sensor_rows(lagging, step)[[0, 2, 3, 4, 5]], nodes[[0, 2, 3, 4]]


def _column(run: Run, substeps: int, chain: np.ndarray, decays: np.ndarray) -> np.ndarray:
    rotor, axis = run.rotor, run.rotor.axis
    law, h, dt = force_law(axis), 1 / (axis.control_rate * substeps), 1 / axis.control_rate
    sensor = rotor.self_sensor
    x = LaneRows(np.zeros((r.ROWS if sensor is None else r.SENSING_ROWS, 1)))
    x[r.COS], x[r.FIRST] = 1.0, np.full((3, 1), np.inf)
    turn = run.speed * h
    x[r.HALF_COS], x[r.HALF_SIN], x[r.TURN_COS], x[r.TURN_SIN] = (
        np.cos(turn / 2),
        np.sin(turn / 2),
        np.cos(turn),
        np.sin(turn),
    )
    x[r.SPEED] = run.speed
    couple = rotor.unbalance.couple * np.exp(1j * np.radians(rotor.unbalance.angle)) * run.speed**2
    x[r.STATIC], x[r.COUPLE] = rotor.unbalance.static * run.speed**2, [[couple.real], [couple.imag]]
    runout = np.array(rotor.runout.amplitude) * np.exp(1j * np.radians(rotor.runout.phase))
    x[r.RUNOUT] = np.stack([runout.real, runout.imag], axis=1).reshape(4, 1)
    x[r.PER_MASS], x[r.PER_INERTIA] = 1 / rotor.moving_mass, 1 / rotor.moving_inertia
    x[r.GYRO] = run.speed * rotor.body.polar_inertia / rotor.moving_inertia
    x[r.GRAVITY] = np.reshape(rotor.gravity, (3, 1)) * rotor.body.mass / rotor.moving_mass
    x[r.AXIAL_K], x[r.AXIAL_C], x[r.AXIAL_STOP] = 2 * rotor.axial.stiffness, rotor.axial.damping, rotor.axial.clearance
    x[r.MAGNETS], x[r.PROBES] = np.reshape(rotor.planes.magnets, (2, 1)), np.reshape(rotor.planes.probes, (2, 1))
    x[r.FLUID_K], x[r.FLUID_C], x[r.CLEARANCE] = rotor.fluid.stiffness, rotor.fluid.damping, axis.clearance
    touch = rotor.touchdown
    x[r.TOUCH_K], x[r.TOUCH_D], x[r.TOUCH_MU] = touch.stiffness, touch.damping, touch.friction
    # Friction changes the slip by at most this much in a step; half of it is where the integration is still stable.
    x[r.TOUCH_SLIP] = touch.friction * h * _pushed(rotor) / 2
    x[r.SURFACE] = run.speed * rotor.body.radius
    x[r.AREA], x[r.BIAS], x[r.REACH] = law.area / 2, law.bias_current, REACH * law.gap
    x[r.FLUX_M], x[r.GAP_M] = law.magnet_flux, law.gap + law.magnet_gap
    x[r.FLUX_C], x[r.GAP_C] = law.coil_flux, law.gap + law.coil_gap
    x[r.SCALE], x[r.CALIBRATION] = law.gain_scale, law.stiffness_scale
    x[r.CHAIN], x[r.DECAYS] = chain, decays
    lsb, u_lsb = (2 * axis.voltage_range / 2**bits for bits in (axis.adc_bits or IDEAL, axis.dac_bits or IDEAL))
    x[r.COUNTS], x[r.COUNT_MAX], x[r.PER_COUNT] = axis.probe_gain / lsb, axis.voltage_range / lsb, lsb / axis.probe_gain
    x[r.NOISE] = axis.noise.displacement
    x[r.PER_U], x[r.U_MAX], x[r.U_COUNT] = (
        1 / (axis.amplifier_gain * u_lsb), axis.voltage_range / u_lsb, axis.amplifier_gain * u_lsb,
    )  # fmt: skip
    into, out = control_matrices(rotor)
    x[r.INTO], x[r.OUT] = into[::2, ::2].reshape(4, 1), out[::2, ::2].reshape(4, 1)
    gains = controllers(rotor)
    x[r.KP] = [[g.kp] for g in gains]
    x[r.KI] = [[g.ki] for g in gains]
    x[r.KD] = [[g.kd / g.td] for g in gains]
    x[r.DECAY_D] = [[np.exp(-dt / g.td)] for g in gains]
    x[r.DECAY_I] = [[np.exp(-dt / g.ti)] for g in gains]
    turned = np.exp(1j * run.speed * dt)
    x[r.STEP_COS], x[r.STEP_SIN] = turned.real, turned.imag
    gain = rejection_gain(rotor, run.speed)
    if gain is not None:
        x[r.REJECT] = np.stack([(turned * gain).real, (turned * gain).imag], axis=-1).reshape(8, 1)
    if sensor is not None:
        x[r.STEP], x[r.COIL_GAP] = h, law.gap
        for coil in range(4):
            first = r.SELF + coil * r.STRIDE
            x[first] = sensor_rows_of([sensor])
            x[first + GAP], x[first + REST_CURRENT] = law.gap, law.bias_current
    return x.values[:, 0]


def _lagging(axis: Rig) -> Rig:
    """The axis with at least a short lag of its probe and its amplifier, which the kernel expects."""
    times = {name: getattr(axis, name) for name in ("sensor_time_constant", "amplifier_time_constant")}
    short = {name: LEAST_LAG for name, time in times.items() if time < LEAST_LAG}
    return replace(axis, **short) if short else axis
