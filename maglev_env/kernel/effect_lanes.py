"""Constants of the further effects in flexible lanes: exact chains, and neutral values of what is absent."""

from collections.abc import Sequence

import numpy as np

from maglev_env.experiment import Experiment, moving_mass
from maglev_env.kernel import effect_rows as r
from maglev_env.kernel.exact import delays, steps
from maglev_env.kernel.exact_flexible import bend, body_maps, current_maps, probe_map
from maglev_env.lane_values import LaneValues, lane_values
from maglev_env.loop import actuator
from maglev_env.loop.eddy import BRANCHES
from maglev_env.loop.effect import EFFECTS, effect_value

# Named, even with neutral values, these need the flexible kernel.
FLEXIBLE = tuple(name for name, card in EFFECTS.items() if card.flexible)
_X1, _X2, _E, _U = 0, 1, 2, 2 + BRANCHES  # what the maps of the current take: x1, x2, branches, both commands


def effect_constants(own: Sequence[Experiment], axis: int, substeps: int) -> np.ndarray:
    """Rows (effect_rows(substeps), n) of the effects of one axis' experiments at their start."""
    rows = np.zeros((r.effect_rows(substeps), len(own)))
    h, fraction, values = steps(own) / substeps, delays(own)[1], lane_values(own)
    gain_scale, pull = actuator.current_scale(values), actuator.central_tangent(values)[0] / values.mass
    _local(rows, own, h, gain_scale)
    _tones(rows, own, h, axis)
    _second_body(rows, values, h)
    probe = probe_map(values, h)
    rows[r.PROBE : r.BEND] = np.concatenate(
        [probe[:, 0, 2:6], probe[:, 1, 2:6], np.delete(probe[:, 2], 1, axis=1), probe[:, 3]], axis=1
    ).T
    for s in range(substeps):
        maps = current_maps(values, values, h, np.clip(fraction - s * h, 0, h) / h)
        nodes, bent = maps.nodes * gain_scale[:, None, None], bend(maps, probe, pull * h**2)
        of_branches = nodes[:, :, _E:_U].swapaxes(1, 2).reshape(len(own), -1)
        rows[r.NODES : r.NEXT] = np.concatenate([nodes[:, :, :_E].reshape(len(own), 6), of_branches], axis=1).T
        ahead = [maps.ahead[:, 0, :1], maps.ahead[:, 1, :2]]
        ahead += [maps.ahead[:, _E + k, [_X1, _X2, _E + k]] for k in range(BRANCHES)]
        rows[r.NEXT : r.COMMAND] = np.concatenate(ahead, axis=1).T
        rows[r.BEND : r.CROSS_BEND] = bent[:, :, :2].reshape(len(own), -1).T
        _put(rows, s, substeps, 0, [nodes, maps.ahead, bent])
    return rows


def write_cross_bend(
    rows: np.ndarray, pull: np.ndarray, own: Sequence[Experiment], other: Sequence[Experiment], substeps: int
) -> None:
    """Write into effect rows what the other axis' current adds to the probe; pull: m/s2 per ampere, (n,)."""
    h, fraction, seeing, driving = steps(own) / substeps, delays(own)[1], lane_values(own), lane_values(other)
    probe = probe_map(seeing, h)
    for s in range(substeps):
        maps = current_maps(driving, seeing, h, np.clip(fraction - s * h, 0, h) / h)
        bent = bend(maps, probe, pull * h**2)
        rows[r.CROSS_BEND : r.NODES] = bent[:, :, :2].reshape(len(own), -1).T
        _put(rows, s, substeps, (r.BY_COMMAND_CROSS - r.COMMAND) // 2, [bent])


def _put(rows: np.ndarray, substep: int, substeps: int, first: int, maps: Sequence[np.ndarray]) -> None:
    """Write the columns of the old and the new command, the last two, where the kernel looks for those of a substep."""
    found = np.concatenate([m[:, :, _U:] for m in maps], axis=1)
    found = found.reshape(len(found), -1).T
    for start in {r.COMMAND, r.command_row(substep) if substeps > 1 else r.COMMAND}:
        rows[start + 2 * first : start + 2 * first + len(found)] = found


def _values(own: Sequence[Experiment], name: str, parameter: str | None = None) -> np.ndarray:
    return np.array([effect_value(e.effects, name, parameter) for e in own])


def _local(rows: np.ndarray, own: Sequence[Experiment], h: np.ndarray, gain_scale: np.ndarray) -> None:
    """What has no memory but one number: voltage limit, hysteresis, eccentricity, friction; its bristles."""
    first = np.array([e.rig.amplifier_time_constant for e in own])
    second = _values(own, "amplifier_lag")
    rows[r.OPEN] = (first == 0) & (second == 0)
    voltage = _values(own, "amplifier_voltage_limit")
    inductance = np.array([e.rig.coil_inductance or np.inf for e in own])
    resistance = np.array([e.rig.coil_resistance for e in own])
    # Where the full voltage takes the current in a step, as a command that the first pole follows to there.
    eased = np.where(resistance > 0, _approached(h, inductance / np.where(resistance > 0, resistance, 1.0)), 0.0)
    slope = np.where(resistance > 0, eased / np.where(resistance > 0, resistance, 1.0), h / inductance)
    per_volt = slope / _approached(h, first)
    limited = np.isfinite(voltage)
    rows[r.REACH] = np.where(limited, np.where(limited, voltage, 0.0) * per_volt, np.inf)
    rows[r.KEPT] = np.where(limited, 1 - resistance * per_volt, 0.0)
    width = _values(own, "hysteresis", "width")
    rows[r.HOLD], rows[r.PER_WIDTH] = gain_scale * _values(own, "hysteresis") * width, 1 / width
    rows[r.OFFSET] = _values(own, "eccentricity")
    mass = np.array([moving_mass(e) for e in own])
    rows[r.FRICTION] = _values(own, "friction") * h**2 / mass
    # A step cannot follow a force that turns faster than it changes the velocity: it would chatter about rest.
    slip, bristle = _values(own, "friction", "velocity") * h, _values(own, "friction", "presliding")
    rows[r.SLIP_SQ] = np.where(bristle > 0, slip, np.maximum(slip, 0.5 * rows[r.FRICTION])) ** 2
    # Nor one that springs faster than a radian in a step; bristles that give way in less act a quarter of it late.
    rows[r.PER_BEND] = np.where(bristle > 0, 1 / np.maximum(np.where(bristle > 0, bristle, 1.0), rows[r.FRICTION]), 0.0)


def _approached(h: np.ndarray, time_constant: np.ndarray) -> np.ndarray:
    """Share of its way that a pole has gone after h."""
    return -np.expm1(-h / np.where(time_constant > 0, time_constant, 1e-300))


def _tones(rows: np.ndarray, own: Sequence[Experiment], h: np.ndarray, axis: int) -> None:
    """Runout, pickup and unbalance; the shaft comes a quarter of a turn later in y."""
    speed = 2 * np.pi / 60 * np.array([e.speed_rpm for e in own])
    mains = 2 * np.pi * _values(own, "pickup", "frequency")
    rows[r.TURN_C], rows[r.TURN_S] = np.cos(speed * h), np.sin(speed * h)
    rows[r.MAINS_TURN_C], rows[r.MAINS_TURN_S] = np.cos(mains * h), np.sin(mains * h)
    quarter = axis * np.pi / 2
    begun = _values(own, "runout", "phase") - quarter
    rows[r.SHAFT_C], rows[r.SHAFT_S] = np.cos(begun), np.sin(begun)
    phase = _values(own, "pickup", "phase")
    rows[r.MAINS_C], rows[r.MAINS_S] = np.cos(phase), np.sin(phase)
    for name, first in (("runout", r.RUNOUT), ("pickup", r.PICKUP)):
        powers = _values(own, name, "harmonics") ** np.arange(3)[:, None]
        rows[first : first + 3] = _values(own, name) * powers
    mass = np.array([moving_mass(e) for e in own])
    force = _values(own, "unbalance") * speed**2 * h**2 / mass
    for node in range(3):
        ahead = _values(own, "unbalance", "phase") - quarter - begun + 0.5 * node * speed * h
        rows[r.UNBALANCE + 2 * node : r.UNBALANCE + 2 * node + 2] = force * np.array([np.cos(ahead), -np.sin(ahead)])


def _second_body(rows: np.ndarray, values: LaneValues, h: np.ndarray) -> None:
    """The second body: how the masses share, and its maps."""
    there = values.effect("support_resonance") > 0
    ratio = np.where(there, values.effect("support_resonance", "mass_ratio"), 0.0)
    rows[r.BODY_SHARE], rows[r.MOVER_SHARE] = ratio / (1 + ratio), 1 / (1 + ratio)
    middle, end, by_nodes = body_maps(values, h)
    rows[r.TO_MIDDLE : r.TO_END] = middle.reshape(len(h), 6).T
    rows[r.TO_END : r.BY_NODES] = end.reshape(len(h), 4).T
    rows[r.BY_NODES : r.PROBE] = by_nodes.reshape(len(h), 6).T
