"""Lanes of the rotor kernel: rotors at their speeds as blocks of its rows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.kernel.exact import actuator_rows, sensor_rows
from maglev_env.lane_values import LaneValues
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.rig.rig import Rig
from maglev_env.rotor import rows as r
from maglev_env.rotor.linear import LEAST_LAG, control_matrices, controllers
from maglev_env.rotor.rotor import Rotor

REACH = 0.98  # of the gap: nearer to a pole its field is no law's any more
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


def block(runs: Sequence[Run], substeps: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Rows (ROWS, LANES) at the start, rotors at rest in the centre, and noise seeds (4, LANES); the last of at most
    LANES runs fills the rest."""
    columns = [_column(run, substeps) for run in runs]
    seeds = [np.random.SeedSequence(run.seed).generate_state(4, np.uint64) for run in runs]
    pad = np.minimum(np.arange(r.LANES), len(runs) - 1)
    return np.ascontiguousarray(np.array(columns).T[:, pad]), np.ascontiguousarray(np.array(seeds).T[:, pad])


def _column(run: Run, substeps: int) -> np.ndarray:
    rotor, axis = run.rotor, run.rotor.axis
    law, h, dt = force_law(axis), 1 / (axis.control_rate * substeps), 1 / axis.control_rate
    x = np.zeros(r.ROWS)
    x[r.COS] = 1.0
    x[r.FIRST : r.FIRST + 3] = np.inf
    turn = run.speed * h
    x[[r.HALF_COS, r.HALF_SIN, r.TURN_COS, r.TURN_SIN]] = np.cos(turn / 2), np.sin(turn / 2), np.cos(turn), np.sin(turn)
    x[r.SPEED] = run.speed
    couple = rotor.unbalance.couple * np.exp(1j * np.radians(rotor.unbalance.angle)) * run.speed**2
    x[r.STATIC], x[r.COUPLE], x[r.COUPLE + 1] = rotor.unbalance.static * run.speed**2, couple.real, couple.imag
    runout = np.array(rotor.runout.amplitude) * np.exp(1j * np.radians(rotor.runout.phase))
    x[r.RUNOUT : r.RUNOUT + 4] = np.stack([runout.real, runout.imag], axis=1).ravel()
    x[r.PER_MASS], x[r.PER_INERTIA] = 1 / rotor.moving_mass, 1 / rotor.moving_inertia
    x[r.GYRO] = run.speed * rotor.body.polar_inertia / rotor.moving_inertia
    x[r.GRAVITY : r.GRAVITY + 3] = np.array(rotor.gravity) * rotor.body.mass / rotor.moving_mass
    x[[r.AXIAL_K, r.AXIAL_C, r.AXIAL_STOP]] = 2 * rotor.axial.stiffness, rotor.axial.damping, rotor.axial.clearance
    x[r.MAGNETS : r.MAGNETS + 2], x[r.PROBES : r.PROBES + 2] = rotor.planes.magnets, rotor.planes.probes
    x[[r.FLUID_K, r.FLUID_C, r.CLEARANCE]] = rotor.fluid.stiffness, rotor.fluid.damping, axis.clearance
    touch = rotor.touchdown
    x[[r.TOUCH_K, r.TOUCH_D, r.TOUCH_MU]] = touch.stiffness, touch.damping, touch.friction
    x[r.SURFACE] = run.speed * rotor.body.radius
    magnets = [r.AREA, r.FLUX_M, r.GAP_M, r.FLUX_C, r.GAP_C, r.BIAS, r.SCALE, r.CALIBRATION, r.REACH]
    x[magnets] = (
        law.area / 2, law.magnet_flux, law.gap + law.magnet_gap, law.coil_flux, law.gap + law.coil_gap,
        law.bias_current, law.gain_scale, law.stiffness_scale, REACH * law.gap,
    )  # fmt: skip
    step, lagging = np.array([h]), LaneValues((_lagging(axis),), ({},))
    x[r.CHAIN : r.CHAIN + 5] = sensor_rows(lagging, step)[[0, 2, 3, 4, 5], 0]
    nodes = actuator_rows(lagging, step, np.zeros(1))[:, 0].reshape(5, 4)[:, 0]
    x[r.DECAYS : r.DECAYS + 4] = nodes[[0, 2, 3, 4]]
    lsb, u_lsb = (2 * axis.voltage_range / 2**bits for bits in (axis.adc_bits or IDEAL, axis.dac_bits or IDEAL))
    x[[r.COUNTS, r.COUNT_MAX, r.PER_COUNT]] = axis.probe_gain / lsb, axis.voltage_range / lsb, lsb / axis.probe_gain
    x[r.NOISE] = axis.noise.displacement
    x[[r.PER_U, r.U_MAX, r.U_COUNT]] = (
        1 / (axis.amplifier_gain * u_lsb), axis.voltage_range / u_lsb, axis.amplifier_gain * u_lsb,
    )  # fmt: skip
    into, out = control_matrices(rotor)
    x[r.INTO : r.INTO + 4], x[r.OUT : r.OUT + 4] = into[::2, ::2].ravel(), out[::2, ::2].ravel()
    gains = controllers(rotor)
    x[r.KP : r.KP + 4] = [g.kp for g in gains]
    x[r.KI : r.KI + 4] = [g.ki for g in gains]
    x[r.KD : r.KD + 4] = [g.kd / g.td for g in gains]
    x[r.DECAY_D : r.DECAY_D + 4] = [np.exp(-dt / g.td) for g in gains]
    x[r.DECAY_I : r.DECAY_I + 4] = [np.exp(-dt / g.ti) for g in gains]
    return x


def _lagging(axis: Rig) -> Rig:
    """The axis with at least a short lag of its probe and its amplifier, which the kernel expects."""
    times = {name: getattr(axis, name) for name in ("sensor_time_constant", "amplifier_time_constant")}
    short = {name: LEAST_LAG for name, time in times.items() if time < LEAST_LAG}
    return replace(axis, **short) if short else axis
