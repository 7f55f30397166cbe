"""From experiments to kernel lanes: which structure each needs, and the constants of its exact linear chains."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from maglev_env.channels import NOISY
from maglev_env.kernel import rows as k
from maglev_env.loop.effect import effect_value
from maglev_env.experiment import Experiment, axis_experiment, moving_mass, self_sensors
from maglev_env.loop.gains import Gains, LinearController
from maglev_env.kernel.step import Structure
from maglev_env.kernel.rows import axis_rows, effect_row, filter_row
from maglev_env.kernel.exact import actuator_rows, delays, sensor_current_rows, sensor_rows, steps
from maglev_env.kernel.controllers import PID_ROWS, filter_constants, pid_constants
from maglev_env.kernel.effect_lanes import FLEXIBLE, effect_constants, write_cross_bend
from maglev_env.lane_values import lane_values
from maglev_env.linear.axis import cross_terms
from maglev_env.loop import actuator
from maglev_env.loop.magnets.law import SingleSidedLaw
from maglev_env.loop.magnets.kinds import KINDS, force_law
from maglev_env.loop.axes import NO_CROSS
from maglev_env.kernel.sensing_lanes import sensed_structure, sensing_rows, timing_of
from selfsense.kernel_rows import GAP as COIL_GAP


@dataclass(frozen=True)
class LaneBatch:
    """Kernel inputs of n experiments of one structure: rows (axes x rows of an axis, then of each axis' self-sensor, n)
    at their start, seeds (axes, 3, n), timing of the self-sensors (4,) as the kernel takes it."""

    structure: Structure
    rows: np.ndarray
    seeds: np.ndarray
    history_length: int
    timing: np.ndarray


def structure_of(experiment: Experiment) -> Structure:
    """The kernel an experiment needs; what its rig and effects do not have is compiled out."""
    effects = experiment.effects
    axes = [axis_experiment(experiment, axis) for axis in range(experiment.rig.axes)]
    rigs = [e.rig for e in axes]
    filters = [e.gains for e in axes if isinstance(e.gains, LinearController)]
    if 0 < len(filters) < len(axes):
        raise ValueError("experiment: give both axes PID gains, or both a linear controller")
    sensors = self_sensors(experiment)
    flexible = any(name in effects for name in FLEXIBLE)
    supported = any(r.support_stiffness > 0 or r.support_damping > 0 for r in rigs) or "damping" in effects
    probe_poles = current_poles = 2
    if not flexible:
        probe_poles = _deepest(r.sensor_time_constant for r in rigs) + (effect_value(effects, "sensor_lag") > 0)
        current_poles = _deepest(r.amplifier_time_constant for r in rigs)
        current_poles += effect_value(effects, "amplifier_lag") > 0
    return Structure(
        magnets=KINDS[rigs[0].magnet].pull(rigs[0]) if rigs[0].controlled else "none",
        supported=supported or flexible,
        sensor_poles=0 if sensors else probe_poles,
        actuator_poles=current_poles,
        delayed=flexible or effect_value(effects, "delay") > 0,
        adc=rigs[0].adc_bits > 0 and not sensors,  # an estimated gap is a number already
        dac=rigs[0].dac_bits > 0,
        noise=experiment.rig.noise.displacement > 0 and not sensors,
        controller_order=max((max(1, f.order) for f in filters), default=0),
        axes=len(axes),
        coupled=experiment.rig.cross != NO_CROSS or "cross_coupling" in effects,
        sensed=sensed_structure(sensors),
        saturating="saturation" in effects,
        flexible=flexible,
        sticking=effect_value(effects, "friction", "presliding") > 0,
    )


def _deepest(time_constants: Iterable[float]) -> int:
    """0 or 1 pole; ValueError when one axis has it and the other does not."""
    poles = {int(t > 0) for t in time_constants}
    if len(poles) > 1:
        raise ValueError("experiment: a time constant is zero in one axis only; give it a small value there, 1e-6 s")
    return poles.pop()


def lane_batch(experiments: Sequence[Experiment], substeps: int = 1) -> LaneBatch:
    """Constants of experiments that share one structure (see `structure_of`)."""
    structure = structure_of(experiments[0])
    parts, seeds, whole = [], [], np.zeros(1)
    views = [[axis_experiment(e, axis) for e in experiments] for axis in range(structure.axes)]
    for own in views:
        rows = np.zeros((axis_rows(substeps, structure.controller_order, structure.flexible), len(experiments)))
        rows[: k.ROWS] = np.array([_parameters(e, substeps) for e in own]).T
        whole, fraction = delays(own)
        rows[k.DELAY_STEPS] = whole
        for s in range(substeps):
            rows[k.ARRIVED + s * k.CHAIN_ROWS] = fraction <= s * steps(own) / substeps
        if structure.flexible:
            rows[effect_row(substeps, structure.controller_order) :] = effect_constants(own, len(parts), substeps)
        else:
            _chains(rows, own, structure, substeps)
        if structure.controller_order:
            start = filter_row(substeps)
            width = 3 * structure.controller_order + 1
            rows[start : start + width] = np.array(
                [filter_constants(e.gains, structure.controller_order) for e in own]
            ).T
        parts.append(rows)
        states = [np.random.SeedSequence(e.seed).generate_state(len(NOISY), np.uint64) for e in own]
        seeds.append(np.array(states).T)
    if structure.coupled:
        for axis, rows in enumerate(parts):
            own, other = views[axis], views[1 - axis]
            terms = [cross_terms(e, axis, beside) for e, beside in zip(experiments, other, strict=True)]
            if structure.flexible:
                pull = np.array([gain / moving_mass(e) for (_, _, gain, _), e in zip(terms, own, strict=True)])
                effects = rows[effect_row(substeps, structure.controller_order) :]
                write_cross_bend(effects, pull, own, other, substeps)
            else:
                _cross_chains(rows, terms, own, other, structure, substeps)
            scales = actuator.current_scale(lane_values(other))
            rows[[k.CROSS_K, k.CROSS_C, k.CROSS_GAIN, k.CROSS_SENSOR]] = np.array(
                [_cross(*lane, substeps) for lane in zip(terms, own, scales, strict=True)]
            ).T
    if structure.axes == 2:  # the bore is round, and no pole may be met in either axis
        nearest = np.minimum(parts[0][k.LIMIT_SQ], parts[1][k.LIMIT_SQ])
        parts[0][k.LIMIT_SQ] = parts[1][k.LIMIT_SQ] = nearest
    if structure.sensed:
        parts += [sensing_rows(own, rows) for own, rows in zip(views, parts, strict=True)]
        for own, rows in zip(views, parts[len(views) :], strict=True):
            rows[COIL_GAP] -= [effect_value(e.effects, "eccentricity") for e in own]
    history = 1 << int(np.ceil(np.log2(whole.max() + 2)))
    timing = np.array(timing_of(experiments[0], substeps))
    return LaneBatch(structure, np.concatenate(parts), np.array(seeds), history, timing)


def _chains(rows: np.ndarray, own: Sequence[Experiment], structure: Structure, substeps: int) -> None:
    """Write the exact chains of one axis."""
    dt, fraction, values = steps(own), delays(own)[1], lane_values(own)
    gain_scale, pull = actuator.current_scale(values), actuator.central_tangent(values)[0] / values.mass
    h = dt / substeps
    for s in range(substeps):
        chain = rows[s * k.CHAIN_ROWS :]
        switch = np.clip(fraction - s * h, 0, h)
        if structure.sensor_poles:
            chain[k.SENSOR : k.SENSOR_CURRENT] = cubic = sensor_rows(values, h)
            chain[k.SENSOR_CURRENT : k.ACTUATOR] = sensor_current_rows(values, values, h, switch, pull * h**2, cubic)
        chain[k.ACTUATOR : k.ARRIVED] = actuator_rows(values, h, switch)
        # States stay in amperes; the currents that make force carry the calibration.
        chain[k.ACTUATOR + 2 * 4 : k.ARRIVED] *= gain_scale


def _cross_chains(
    rows: np.ndarray,
    terms: Sequence[tuple[float, ...]],
    own: Sequence[Experiment],
    other: Sequence[Experiment],
    structure: Structure,
    substeps: int,
) -> None:
    """Write what the other axis' current adds to this axis' motion inside a step, as its probe sees it."""
    if not structure.sensor_poles:
        return
    h, fraction, seeing, driving = steps(own) / substeps, delays(own)[1], lane_values(own), lane_values(other)
    pull = np.array([gain for _, _, gain, _ in terms]) / seeing.mass
    for s in range(substeps):
        chain = rows[s * k.CHAIN_ROWS :]
        switch, cubic = np.clip(fraction - s * h, 0, h), chain[k.SENSOR : k.SENSOR_CURRENT]
        chain[k.CROSS_CURRENT : k.CROSS_CURRENT + 8] = sensor_current_rows(
            driving, seeing, h, switch, pull * h**2, cubic
        )


def _cross(
    terms: tuple[float, ...], own: Experiment, current_scale: float, substeps: int
) -> tuple[float, float, float, float]:
    """The other axis' terms in this one, in the kernel's units: force times h^2 / m, current as its law scales it."""
    stiffness, damping, gain, sensor = terms
    h = 1 / own.rig.control_rate / substeps
    per_mass = h**2 / moving_mass(own)
    return stiffness * per_mass, damping * per_mass / h, gain * per_mass / current_scale, sensor


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
    if e.sensor != "probe":  # an estimated gap passes no converter
        p[k.PROBE_COUNTS], p[k.COUNT_MAX], p[k.PER_COUNT] = probe / rig.probe_gain, np.inf, 1.0
    if isinstance(gains, Gains):
        p[PID_ROWS] = pid_constants(gains, dt)
    p[k.PER_U_COUNT], p[k.U_COUNT_MAX], p[k.U_COUNT] = 1 / u_lsb, current_range / u_lsb, u_lsb
    p[k.NOISE] = rig.noise.displacement
    # The kernel's velocity is h v and its acceleration h^2 a, so every force carries h^2 / m.
    h = dt / substeps
    per_mass = h**2 / moving_mass(e)
    if rig.controlled:
        law = force_law(rig)
        p[k.BIAS] = law.bias_current
        p[k.CALIBRATION] = law.stiffness_scale * (1 + effect_value(effects, "negative_stiffness"))
        p[k.GAP], p[k.GAPM] = law.gap, law.gap + law.magnet_gap
        p[k.GAP2], p[k.GAPM2] = law.gap**2, (law.gap + law.magnet_gap) ** 2
        if isinstance(law, SingleSidedLaw):
            p[k.FLUX_M] = np.sqrt(law.area * per_mass) * law.magnet_flux
            # Calibration scales the nominal balance; what another mass weighs beyond it is not the magnet's.
            extra = law.weight * effect_value(effects, "mass")
            p[k.WEIGHT] = (p[k.CALIBRATION] * law.weight + extra) * per_mass
            p[k.EXPONENT] = law.exponent
            # An electromagnet's field squares, a magnet's pull is linear in the current.
            p[k.FLUX_C] = law.magnet_pull * per_mass if law.magnet_pull else np.sqrt(law.iron_pull * per_mass)
        else:
            p[k.KNEE] = 1 / (4 * effect_value(effects, "saturation") ** 2 * law.area * per_mass) ** 2
            # Sums and differences of the two gaps' fields carry a factor two; fields in root(h^2 / m N).
            p[[k.FLUX_M, k.FLUX_C]] = 2 * np.sqrt(law.area * per_mass) * np.array([law.magnet_flux, law.coil_flux])
    p[k.KS] = rig.support_stiffness * (1 + effect_value(effects, "support_stiffness")) * per_mass
    p[k.CS] = (rig.support_damping + effect_value(effects, "damping")) * per_mass / h
    p[k.PER_MASS] = per_mass
    # The force law is singular where the rotor meets a pole; contact comes first.
    centred = max(0.999 * rig.gap - abs(effect_value(effects, "eccentricity")), 0.0)
    p[k.LIMIT_SQ] = min(rig.clearance, centred) ** 2
    return p
