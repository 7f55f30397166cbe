"""From experiments to kernel lanes: which structure each needs, and the constants of its exact linear chains."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from maglev_env.channels import NOISY
from maglev_env.experiment import Experiment, axis_experiment, axis_seed, self_sensors
from maglev_env.kernel.controllers import PID_ROWS, controller_kind, filter_rows, pid_constants
from maglev_env.kernel.effect_lanes import FLEXIBLE, write_flexible, write_flexible_cross
from maglev_env.kernel.exact import actuator_rows, delays, sensor_current_rows, sensor_rows, steps
from maglev_env.kernel.exact_flexible import body_maps
from maglev_env.kernel.layout import AXIS, of_substep
from maglev_env.kernel.sensing_lanes import sensed_structure, timing_of, write_self_sensors
from maglev_env.kernel.structure import Structure
from maglev_env.lane_values import LaneValues, lane_values
from maglev_env.linear.axis import cross_terms
from maglev_env.loop import (
    actuator,
    amplifier,
    controller,
    external,
    further_body,
    mechanics,
    second_body,
    sensor,
)
from maglev_env.loop.axes import NO_CROSS
from maglev_env.loop.effect import Effects, effect_value, shaped
from maglev_env.loop.free import places as free
from maglev_env.loop.further import blocks as further
from maglev_env.loop.gains import Gains, digital, of_axis
from maglev_env.loop.magnets import rows as magnet_rows
from maglev_env.loop.magnets.kinds import simulated_as, steeper
from maglev_lanes.layout import LaneRows, row


@dataclass(frozen=True)
class LaneBatch:
    """Kernel inputs of n experiments of one structure.

    Args:
        structure: their common structure.
        rows: initial values, (rows, n), see `maglev_env.kernel.layout`.
        seeds: of the noise channels, (axes, 3, n).
        history_length: commands kept per axis and lane, a power of two.
        timing: of the self-sensors, (4,), as the kernel takes it.
    """

    structure: Structure
    rows: np.ndarray
    seeds: np.ndarray
    history_length: int
    timing: np.ndarray


def structure_of(experiment: Experiment) -> Structure:
    """The structure of the kernel for an experiment; parts that its rig and effects do not need are compiled out."""
    effects = experiment.effects
    axes = [axis_experiment(experiment, axis) for axis in range(experiment.rig.axes)]
    rigs = [e.rig for e in axes]
    order, of_error = 0, True
    if experiment.rig.controlled:
        order, of_error = controller_kind(experiment.gains, 1 / experiment.rig.control_rate)
    sensors = self_sensors(experiment)
    flexible = any(name in effects for name in FLEXIBLE) or _bent_current(effects)
    supported = any(r.support_stiffness > 0 or r.support_damping > 0 for r in rigs) or "damping" in effects
    probe_poles = current_poles = 2
    if not flexible:
        probe_poles = _deepest(r.sensor_time_constant for r in rigs) + (effect_value(effects, "sensor_lag") > 0)
        current_poles = _deepest(r.amplifier_time_constant for r in rigs)
        current_poles += effect_value(effects, "amplifier_lag") > 0
    return Structure(
        magnets=simulated_as(rigs[0].magnet),
        supported=supported or flexible,
        sensor_poles=0 if sensors else probe_poles,
        actuator_poles=current_poles,
        delayed=flexible or effect_value(effects, "delay") > 0,
        noise=experiment.rig.noise.displacement > 0 and not sensors,
        controller_order=order,
        of_error=of_error,
        axes=len(axes),
        coupled=experiment.rig.cross != NO_CROSS or "cross_coupling" in effects,
        sensed=sensed_structure(sensors),
        saturating="saturation" in effects and "pair" in experiment.rig.capabilities,
        steeper=any(steeper(rig, effects) for rig in rigs),
        flexible=flexible,
        sticking=effect_value(effects, "friction", "presliding") > 0,
        further=not further.NAMES.isdisjoint(effects),
        free=not free.NAMES.isdisjoint(effects),
        shaped=shaped(effects),
    )


def _bent_current(effects: Effects) -> bool:
    """Whether a saturation sits at the current or the command, which only the flexible kernel has."""
    return any(np.isfinite(effect_value(effects, "saturation", at)) for at in ("current", "command"))


def _deepest(time_constants: Iterable[float]) -> int:
    """Number of poles, 0 or 1.

    Raises:
        ValueError: One axis has the pole and the other one has not.
    """
    poles = {int(t > 0) for t in time_constants}
    if len(poles) > 1:
        raise ValueError("experiment: a time constant is zero in one axis only; give it a small value there, 1e-6 s")
    return poles.pop()


def lane_batch(experiments: Sequence[Experiment], substeps: int = 1, structure: Structure | None = None) -> LaneBatch:
    """Constants of experiments that share a structure: by default that of `structure_of`."""
    structure = structure or structure_of(experiments[0])
    # Of lanes that differ in gains and seed alone, as those of a sweep, one is worked out.
    alike: dict[tuple, int] = {}
    of_lane = [alike.setdefault(_constants_of(e), i) for i, e in enumerate(experiments)]
    first = list(alike.values())
    made = _worked_out([experiments[i] for i in first], substeps, structure)
    rows = made.rows[:, np.searchsorted(first, of_lane)]
    for axis in range(structure.axes):
        own, dt = [of_axis(e.gains, axis) for e in experiments], 1 / experiments[0].rig.control_rate
        if isinstance(own[0], Gains):
            places = [axis * row(AXIS) + at for at in PID_ROWS]
            rows[places] = np.array([pid_constants(gains, dt) for gains in own if isinstance(gains, Gains)]).T
    seeds = [[_seeds(axis_seed(e, axis)) for e in experiments] for axis in range(structure.axes)]
    return replace(made, rows=rows, seeds=np.array(seeds).swapaxes(1, 2))


def structural(e: Experiment) -> tuple:
    """What the structure of an experiment depends on, which leaves out the values of PID gains."""
    gains = e.gains if isinstance(e.gains, tuple) else (e.gains,)
    effects = tuple((name, *values.items()) for name, values in e.effects.items())
    apart = tuple(e.apart.items())
    return id(e.rig), id(e.sensor), effects, apart, tuple(type(g) if isinstance(g, Gains) else id(g) for g in gains)


def _constants_of(e: Experiment) -> tuple:
    """What the constants of a lane depend on, except the rows of PID gains."""
    return *structural(e), e.speed_rpm


def _worked_out(experiments: Sequence[Experiment], substeps: int, structure: Structure) -> LaneBatch:
    """All constants of each of these experiments."""
    n = len(experiments)
    views = [[axis_experiment(e, axis) for e in experiments] for axis in range(structure.axes)]
    values = [lane_values(own) for own in views]
    axes = [LaneRows(np.zeros((row(AXIS), n))) for _ in views]
    # Both axes share the rate and the delay.
    h, (whole, fraction) = steps(experiments) / substeps, delays(experiments)
    for axis, x in enumerate(axes):
        _fill(x, views[axis], values[axis], structure, axis, h)
        x[controller.DELAY_STEPS] = whole
    if structure.axes == 2:  # the bore is a circle, so the smaller limit of both axes holds
        nearest = np.minimum(axes[0][mechanics.LIMIT_SQ], axes[1][mechanics.LIMIT_SQ])
        axes[0][mechanics.LIMIT_SQ] = axes[1][mechanics.LIMIT_SQ] = nearest
    pulls = [_cross(x, experiments, views, values, axis, h) for axis, x in enumerate(axes) if structure.coupled]
    # The coefficients of commands differ between substeps, because a command may change within one of them.
    rows, kept = row(of_substep(structure.flexible)), []
    for s in reversed(range(substeps if structure.delayed else 1)):
        switch = np.clip(fraction - s * h, 0, h)
        for axis, x in enumerate(axes):
            x[controller.ARRIVED] = fraction <= s * h
            _chains(x, values[axis], structure, h, switch)
            if structure.coupled:
                _cross_chains(x, pulls[axis], values[1 - axis], values[axis], structure, h, switch)
        kept.insert(0, np.concatenate([x.values[rows] for x in axes]))
    filters = [_filters(own, structure) for own in views if structure.controller_order]
    parts = [x.values for x in axes] + filters + (kept if structure.delayed and substeps > 1 else [])
    seeds = [[_seeds(e.seed) for e in own] for own in views]
    history = 1 << int(np.ceil(np.log2(whole.max() + 2)))
    timing = np.array(timing_of(experiments[0], substeps))
    return LaneBatch(structure, np.concatenate(parts), np.array(seeds).swapaxes(1, 2), history, timing)


@lru_cache(maxsize=1024)
def _seeds(seed: int | tuple[int, ...]) -> np.ndarray:
    """Seeds of the noise of each channel; many lanes have the same one."""
    return np.random.SeedSequence(seed).generate_state(len(NOISY), np.uint64)


def _fill(
    x: LaneRows, own: Sequence[Experiment], values: LaneValues, structure: Structure, axis: int, h: np.ndarray
) -> None:
    """Write the constants of every block of an axis, except the exact discretisations."""
    mechanics.fill(x, values, h)
    controller.fill(x, values)
    sensor.fill(x, values, probe=not structure.sensed)
    if isinstance(own[0].gains, Gains):
        x.values[PID_ROWS] = np.array([pid_constants(e.gains, 1 / e.rig.control_rate) for e in own]).T
    if structure.magnets != "none":
        magnet_rows.fill(x, values.laws, h**2 / values.mass, values.effect)
    if structure.flexible:
        bodies = further_body if structure.shaped else second_body
        bodies.fill(x, values, body_maps(values, h, further=structure.shaped))
        amplifier.fill(x, values, h)
        actuator.fill(x, values, h)
        sensor.fill_tones(x, values, h, axis)
        external.fill(x, values, h)
    for block in further.BLOCKS if structure.further else ():
        block.fill(x, values, h, axis)
    if structure.free:
        free.fill(x, values, h)
    if structure.sensed:
        write_self_sensors(x, own)


def _filters(own: Sequence[Experiment], structure: Structure) -> np.ndarray:
    """Rows of the linear controllers of one axis."""
    return np.array([filter_rows(digital(e.gains, 1 / e.rig.control_rate), structure) for e in own]).T


def _chains(x: LaneRows, values: LaneValues, structure: Structure, h: np.ndarray, switch: np.ndarray) -> None:
    """Write the exact discretisation of one axis for a substep in which the new command acts from `switch` (s)."""
    if structure.flexible:
        write_flexible(x, values, h, switch)
        return
    gain_scale, pull = actuator.current_scale(values), actuator.central_tangent(values)[0] / values.mass
    if structure.sensor_poles:
        x[sensor.CUBIC] = cubic = sensor_rows(values, h)
        x[sensor.BEND] = sensor_current_rows(values, values, h, switch, pull * h**2, cubic)
    found = actuator_rows(values, h, switch)
    # States are in amperes; the calibration is applied to the force-producing currents.
    x[amplifier.NEXT], x[amplifier.NODES] = found[:8], found[8:] * gain_scale


def _cross(
    x: LaneRows,
    experiments: Sequence[Experiment],
    views: Sequence[Sequence[Experiment]],
    values: Sequence[LaneValues],
    axis: int,
    h: np.ndarray,
) -> np.ndarray:
    """Write the coupling of the other axis into an axis, and return its acceleration (m/s2) per ampere, (n,)."""
    other = 1 - axis
    terms = [cross_terms(e, axis, beside) for e, beside in zip(experiments, views[other], strict=True)]
    stiffness, damping, gain, sensed = np.array(terms).T
    per_mass = h**2 / values[axis].mass
    x[mechanics.CROSS_SPRING], x[mechanics.CROSS_DAMPER] = stiffness * per_mass, damping * per_mass / h
    x[mechanics.CROSS_GAIN] = gain * per_mass / actuator.current_scale(values[other])
    x[sensor.CROSS_SENSOR] = sensed
    return gain / values[axis].mass


def _cross_chains(
    x: LaneRows,
    pull: np.ndarray,
    driving: LaneValues,
    seeing: LaneValues,
    structure: Structure,
    h: np.ndarray,
    switch: np.ndarray,
) -> None:
    """Write the correction of the probe for the motion that the other axis' current causes within a substep."""
    if structure.flexible:
        write_flexible_cross(x, pull, driving, seeing, h, switch)
    elif structure.sensor_poles:
        cubic = x.values[row(sensor.CUBIC) : row(sensor.BEND)]
        x[sensor.CROSS_BEND] = sensor_current_rows(driving, seeing, h, switch, pull * h**2, cubic)
