"""From experiments to kernel lanes: which structure each needs, and the constants of its exact linear chains."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from maglev_env import kernel as k
from maglev_env.effects import effect_value, split_delay
from maglev_env.experiment import Experiment
from maglev_env.magnetics import force_law, linearise

SEEDED = ("displacement", "current", "force")  # noise channels, each with a stream of its own


@dataclass(frozen=True)
class LaneBatch:
    """Kernel inputs of n experiments of one structure: rows (see `kernel`, n) at their start, seeds (3, n)."""

    structure: k.Structure
    rows: np.ndarray
    seeds: np.ndarray
    history_length: int


def structure_of(experiment: Experiment) -> k.Structure:
    """The kernel an experiment needs; what its rig and effects do not have is compiled out."""
    rig, effects = experiment.rig, experiment.effects
    return k.Structure(
        magnets="none" if rig.magnet == "none" else rig.flux_path,
        supported=rig.support_stiffness > 0 or rig.support_damping > 0 or "damping" in effects,
        sensor_poles=int(rig.sensor_time_constant > 0) + int(effect_value(effects, "sensor_lag") > 0),
        actuator_poles=int(rig.amplifier_time_constant > 0) + int(effect_value(effects, "amplifier_lag") > 0),
        delayed=effect_value(effects, "delay") > 0,
        adc=rig.adc_bits > 0,
        dac=rig.dac_bits > 0,
        noise=rig.noise.displacement > 0,
    )


def lane_batch(experiments: Sequence[Experiment], substeps: int = 1) -> LaneBatch:
    """Constants of experiments that share one structure (see `structure_of`)."""
    rows = np.zeros((k.ROWS + (substeps - 1) * k.CHAIN_ROWS, len(experiments)))
    rows[: k.ROWS] = np.array([_parameters(e, substeps) for e in experiments]).T
    dt = np.array([1 / e.rig.control_rate for e in experiments])
    whole, fraction = np.array([split_delay(e.effects, t) for e, t in zip(experiments, dt, strict=True)]).T
    rows[k.DELAY_STEPS] = whole
    structure = structure_of(experiments[0])
    sensor = _poles([(e.rig.sensor_time_constant, effect_value(e.effects, "sensor_lag")) for e in experiments])
    amplifier = _poles([(e.rig.amplifier_time_constant, effect_value(e.effects, "amplifier_lag")) for e in experiments])
    gain_scale, pull = np.array([_actuator(e) for e in experiments]).T
    h = dt / substeps
    for s in range(substeps):
        chain = rows[s * k.CHAIN_ROWS :]
        switch = np.clip(fraction - s * h, 0, h)
        if structure.sensor_poles:
            probe = sensor[:, : structure.sensor_poles]
            chain[k.SENSOR : k.SENSOR_CURRENT] = cubic = _sensor_rows(probe, h)
            chain[k.SENSOR_CURRENT : k.ACTUATOR] = _sensor_current_rows(
                probe, amplifier[:, : structure.actuator_poles], h, switch, pull * h**2, cubic
            )
        actuator = _actuator_rows(amplifier[:, : structure.actuator_poles], h, switch)
        actuator[2 * 4 :] *= gain_scale  # states stay in amperes; the currents that make force carry the calibration
        chain[k.ACTUATOR : k.AT_START] = actuator
    rows[k.AT_START], rows[k.AT_START + 1] = fraction > 0, fraction <= 0
    seeds = np.array([np.random.SeedSequence(e.seed).generate_state(len(SEEDED), np.uint64) for e in experiments]).T
    history = 1 << int(np.ceil(np.log2(whole.max() + 2)))
    return LaneBatch(structure, rows, seeds, history)


def _parameters(e: Experiment, substeps: int) -> np.ndarray:
    rig, effects, gains = e.rig, e.effects, e.gains
    p = np.zeros(k.ROWS)
    p[k.ALIVE] = 1.0
    dt = 1 / rig.control_rate
    probe = rig.probe_gain * (1 + effect_value(effects, "sensor_gain"))
    lsb = 2 * rig.voltage_range / 2**rig.adc_bits if rig.adc_bits else 1.0
    current_range = rig.voltage_range * rig.amplifier_gain
    u_lsb = 2 * current_range / 2**rig.dac_bits if rig.dac_bits else 1.0
    p[k.PROBE_COUNTS], p[k.COUNT_MAX], p[k.PER_COUNT] = probe / lsb, rig.voltage_range / lsb, lsb / rig.probe_gain
    p[k.KP], p[k.KD], p[k.KI] = gains.kp, gains.kd / gains.td, gains.ki
    p[k.PER_U_COUNT], p[k.U_COUNT_MAX], p[k.U_COUNT] = 1 / u_lsb, current_range / u_lsb, u_lsb
    p[k.DECAY_D], p[k.DECAY_I] = np.exp(-dt / gains.td), np.exp(-dt / gains.ti)
    p[k.NOISE] = rig.noise.displacement
    # The kernel's velocity is h v and its acceleration h^2 a, so every force carries h^2 / m.
    h = dt / substeps
    per_mass = h**2 / (rig.mass * (1 + effect_value(effects, "mass")))
    if rig.magnet != "none":
        law = force_law(rig)
        p[k.GAP], p[k.GAPM] = law.gap, law.gap + law.magnet_gap
        p[k.GAP2], p[k.GAPM2] = law.gap**2, (law.gap + law.magnet_gap) ** 2
        # Sums and differences of the two gaps' fields carry a factor two; fields in root(h^2 / m N).
        p[[k.FLUX_M, k.FLUX_C]] = 2 * np.sqrt(law.area * per_mass) * np.array([law.magnet_flux, law.coil_flux])
        p[k.BIAS] = law.bias_current
        p[k.CALIBRATION] = law.stiffness_scale * (1 + effect_value(effects, "negative_stiffness"))
    p[k.KS] = rig.support_stiffness * (1 + effect_value(effects, "support_stiffness")) * per_mass
    p[k.CS] = (rig.support_damping + effect_value(effects, "damping")) * per_mass / h
    p[k.PER_MASS] = per_mass
    # The force law is singular where the rotor meets a pole; contact comes first.
    p[k.LIMIT] = min(rig.clearance, 0.999 * rig.gap)
    return p


def _actuator(e: Experiment) -> tuple[float, float]:
    """The force law's current scale, and the acceleration per ampere (m/s2 A) at the centre."""
    if e.rig.magnet == "none":
        return 1.0, 0.0
    law, change = force_law(e.rig), 1 + effect_value(e.effects, "actuator_gain")
    return law.gain_scale * change, linearise(law)[0] * change / (e.rig.mass * (1 + effect_value(e.effects, "mass")))


def _poles(pairs: list[tuple[float, float]]) -> np.ndarray:
    """Non-zero time constants first, shape (n, 2)."""
    return np.array([sorted(pair, key=lambda t: t == 0) for pair in pairs])


def _sensor_rows(poles: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Next probe states from (z1, z2, y0, h v0, y1, h v1) with y the cubic through both ends; shape (12, n)."""
    n = len(poles)
    # States z1, z2 and the scaled derivatives y, h y', h^2 y'', h^3 y''' of the cubic, over one unit of tau / h.
    a = np.zeros((n, 6, 6))
    _put_poles(a, poles, h, first=0, source=2)
    a[:, 2, 3] = a[:, 3, 4] = a[:, 4, 5] = 1.0
    step = expm(a)[:, :2]
    hermite = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [-6, -4, 6, -2], [12, 6, -12, 6]])  # derivatives at the start
    rows = np.concatenate([step[:, :, :2], step[:, :, 2:] @ hermite], axis=2)
    return rows.reshape(n, 12).T


def _sensor_current_rows(
    sensor: np.ndarray, amplifier: np.ndarray, h: np.ndarray, switch: np.ndarray, pull: np.ndarray, cubic: np.ndarray
) -> np.ndarray:
    """What the probe states gain over the cubic motion, from (x1, x2, old command, new command); shape (8, n).

    The current bends the motion inside a step by more than a cubic can follow. Its exact effect on the probe, with
    the acceleration pull (m per step^2 and ampere) of the centred rotor, less what the cubic through the ends of that
    same motion gives.
    """
    n = len(sensor)
    # States x1, x2, command, y, v, z1, z2, over one unit of tau / h.
    a = np.zeros((n, 7, 7))
    source = _put_poles(a, amplifier, h, first=0, source=2)
    a[:, 4, source], a[:, 3, 4] = pull, 1.0
    _put_poles(a, sensor, h, first=5, source=3)
    end = _switched(a, switch / h, np.ones(n))
    rows = cubic.T.reshape(n, 2, 6)
    return (end[:, 5:7] - rows[:, :, 4:] @ end[:, 3:5]).reshape(n, 8).T


def _put_poles(a: np.ndarray, poles: np.ndarray, h: np.ndarray, first: int, source: int) -> int:
    """Write a cascade of poles into the system matrices a, fed by state `source`; returns its output state."""
    for j in range(poles.shape[1]):
        rate = h / poles[:, j]
        a[:, first + j, first + j], a[:, first + j, source] = -rate, rate
        source = first + j
    return source


def _actuator_rows(poles: np.ndarray, h: np.ndarray, switch: np.ndarray) -> np.ndarray:
    """Next states and nodal currents from (x1, x2, old command, new command); shape (20, n).

    The new command acts from `switch` (s) on. The three nodal currents c0, c1, c2 stand for the current in the
    integration step so that its impulse (c0 + 4 c1 + c2) h / 6 and its displacement (c0 + 2 c1) h^2 / 6 are exact.
    """
    n, order = poles.shape
    # States x1, x2, command, integral and double integral of the current, over one unit of tau / h.
    a = np.zeros((n, 5, 5))
    source = _put_poles(a, poles, h, first=0, source=2)
    a[:, 3, source] = a[:, 4, 3] = 1.0
    s = switch / h
    full = _switched(a, s, np.ones(n))
    middle = _switched(a, np.minimum(s, 0.5), np.full(n, 0.5))
    mean, moment = full[:, 3], 2 * full[:, 4]
    # Without a pole the command itself may jump inside the step: its mean stands for the middle.
    c1 = middle[:, order - 1] if order else mean
    c0 = 3 * moment - 2 * c1
    c2 = 6 * mean - 4 * c1 - c0
    next_states = full[:, :2].copy()
    next_states[:, order:] = 0.0
    return np.concatenate([next_states, c0[:, None], c1[:, None], c2[:, None]], axis=1).reshape(n, 20).T


def _switched(a: np.ndarray, switch: np.ndarray, end: np.ndarray) -> np.ndarray:
    """State map (n, states, 4) over [0, end] from (x1, x2, old, new): the command, state 2, changes at `switch`."""
    first = expm(a * switch[:, None, None])
    second = expm(a * (end - switch)[:, None, None])
    state = np.concatenate([first[:, :, :3], np.zeros((*a.shape[:2], 1))], axis=2)
    state[:, 2] = [0.0, 0.0, 0.0, 1.0]
    return second @ state
