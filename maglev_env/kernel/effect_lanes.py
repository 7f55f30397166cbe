"""Constants of the further effects in flexible lanes: exact chains with every pole there is, and neutral values."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maglev_env.kernel import effect_rows as r
from maglev_env.loop.eddy import BRANCHES, eddy_branches
from maglev_env.loop.effect import EFFECTS, effect_value
from maglev_env.experiment import Experiment, moving_mass
from maglev_env.kernel.exact import HERMITE, actuator, delays, steps, switched
from maglev_lanes.matrix_exponential import expm

# Named, even with neutral values, these need the flexible kernel.
FLEXIBLE = tuple(name for name, card in EFFECTS.items() if card.flexible)
# States of the chain from command to reading, over one unit of tau / h: x1, x2, branches, command, impulse and
# displacement of the current that pulls, mount and its velocity, z1, z2.
_X1, _X2, _E = 0, 1, 2
_U = _E + BRANCHES
_V, _Y, _M, _MV, _Z1, _Z2, _STATES = range(_U + 1, _U + 8)


def effect_constants(own: Sequence[Experiment], axis: int, substeps: int) -> np.ndarray:
    """Rows (effect_rows(substeps), n) of the effects of one axis' experiments at their start."""
    rows = np.zeros((r.effect_rows(substeps), len(own)))
    h, fraction = steps(own) / substeps, delays(own)[1]
    _local(rows, own, h)
    _tones(rows, own, h, axis)
    _second_body(rows, own, h)
    gain_scale, pull = np.array([actuator(e) for e in own]).T
    probe = _probe(own, h)
    rows[r.PROBE : r.BEND] = np.concatenate(
        [probe[:, 0, 2:6], probe[:, 1, 2:6], np.delete(probe[:, 2], 1, axis=1), probe[:, 3]], axis=1
    ).T
    for s in range(substeps):
        maps = _maps(own, own, h, np.clip(fraction - s * h, 0, h) / h)
        nodes, bend = maps.nodes * gain_scale[:, None, None], _bend(maps, probe, pull * h**2)
        of_branches = nodes[:, :, _E:_U].swapaxes(1, 2).reshape(len(own), -1)
        rows[r.NODES : r.NEXT] = np.concatenate([nodes[:, :, :_E].reshape(len(own), 6), of_branches], axis=1).T
        ahead = [maps.ahead[:, 0, :1], maps.ahead[:, 1, :2]]
        ahead += [maps.ahead[:, _E + k, [_X1, _X2, _E + k]] for k in range(BRANCHES)]
        rows[r.NEXT : r.COMMAND] = np.concatenate(ahead, axis=1).T
        rows[r.BEND : r.CROSS_BEND] = bend[:, :, :2].reshape(len(own), -1).T
        _put(rows, s, substeps, 0, [nodes, maps.ahead, bend])
    return rows


def write_cross_bend(
    rows: np.ndarray, pull: np.ndarray, own: Sequence[Experiment], other: Sequence[Experiment], substeps: int
) -> None:
    """Write into effect rows what the other axis' current adds to the probe; pull: m/s2 per ampere, (n,)."""
    h, fraction = steps(own) / substeps, delays(own)[1]
    probe = _probe(own, h)
    for s in range(substeps):
        bend = _bend(_maps(other, own, h, np.clip(fraction - s * h, 0, h) / h), probe, pull * h**2)
        rows[r.CROSS_BEND : r.NODES] = bend[:, :, :2].reshape(len(own), -1).T
        _put(rows, s, substeps, (r.BY_COMMAND_CROSS - r.COMMAND) // 2, [bend])


def _put(rows: np.ndarray, substep: int, substeps: int, first: int, maps: Sequence[np.ndarray]) -> None:
    """Write the columns of the old and the new command, the last two, where the kernel looks for those of a substep."""
    found = np.concatenate([m[:, :, _U:] for m in maps], axis=1)
    found = found.reshape(len(found), -1).T
    for start in {r.COMMAND, r.command_row(substep) if substeps > 1 else r.COMMAND}:
        rows[start + 2 * first : start + 2 * first + len(found)] = found


def _values(own: Sequence[Experiment], name: str, parameter: str | None = None) -> np.ndarray:
    return np.array([effect_value(e.effects, name, parameter) for e in own])


def _local(rows: np.ndarray, own: Sequence[Experiment], h: np.ndarray) -> None:
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
    gain_scale = np.array([actuator(e)[0] for e in own])
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


def _second_body(rows: np.ndarray, own: Sequence[Experiment], h: np.ndarray) -> None:
    """Relative to the mover an oscillator of 1 + ratio times its stiffness, driven by the mover's other forces."""
    turn = 2 * np.pi * _values(own, "support_resonance") * h
    there = turn > 0
    ratio = np.where(there, _values(own, "support_resonance", "mass_ratio"), 0.0)
    damping = _values(own, "support_resonance", "damping_ratio")
    rows[r.BODY_SHARE], rows[r.MOVER_SHARE] = ratio / (1 + ratio), 1 / (1 + ratio)
    # States: position, velocity, then the acceleration as a parabola with its slope and bend.
    a = np.zeros((len(own), 5, 5))
    a[:, 0, 1] = a[:, 2, 3] = a[:, 3, 4] = 1.0
    a[:, 1, 0], a[:, 1, 1], a[:, 1, 2] = -(1 + ratio) * turn**2, -2 * damping * (1 + ratio) * turn, -1.0
    nodes = np.array([[1, 0, 0], [-3, 4, -1], [4, -8, 4]])  # value, slope, bend at the start from the three nodes
    middle, end = (there[:, None, None] * expm(a * span)[:, :2] for span in (0.5, 1.0))
    rows[r.TO_MIDDLE : r.TO_END] = middle[:, :, :3].reshape(len(own), 6).T
    rows[r.TO_END : r.BY_NODES] = end[:, :, :2].reshape(len(own), 4).T
    rows[r.BY_NODES : r.PROBE] = (end[:, :, 2:] @ nodes).reshape(len(own), 6).T


def _probe(own: Sequence[Experiment], h: np.ndarray) -> np.ndarray:
    """Next mount, its velocity, z1 and z2 from (z1, z2, mount, mount_v, moved, pushed, y0, h v0, y1, h v1): (n, 4, 10).

    y is the cubic through both ends; the mount sees an acceleration of the bearing that is linear in time and moves
    the mover by `moved` and speeds it by `pushed`.
    """
    n = len(own)
    # States: mount, mount_v, z1, z2, y and its three derivatives, acceleration and its slope.
    a = np.zeros((n, 10, 10))
    for k in (4, 5, 6, 8):
        a[:, k, k + 1] = 1.0
    a[:, 0, 1] = 1.0
    coupling = _put_mount(a, own, h, 0)
    a[:, 1, 8] = -coupling
    z = _put_probe(a, own, h, mount=0, y=4, first=2)
    end = _readings(expm(a), z, mount=0, y=4, first=2)
    cubic = end[:, :, 4:8] @ HERMITE
    linear = end[:, :, 8:] @ np.array([[6, -2], [-12, 6]])
    return np.concatenate([end[:, :, 2:4], end[:, :, :2], linear, cubic], axis=2)


def _put_mount(a: np.ndarray, own: Sequence[Experiment], h: np.ndarray, mount: int) -> np.ndarray:
    """Write the mount's mode into the matrices; returns its coupling to the bearing's acceleration, 0 without one."""
    turn = 2 * np.pi * _values(own, "sensor_resonance") * h
    a[:, mount + 1, mount] = -(turn**2)
    a[:, mount + 1, mount + 1] = -2 * _values(own, "sensor_resonance", "damping_ratio") * turn
    return np.where(turn > 0, _values(own, "sensor_resonance", "coupling"), 0.0)


def _put_probe(a: np.ndarray, own: Sequence[Experiment], h: np.ndarray, mount: int, y: int, first: int) -> np.ndarray:
    """Write the probe's poles, reading y less the mount; returns which of both there are, (n, 2)."""
    times = np.array([(e.rig.sensor_time_constant, effect_value(e.effects, "sensor_lag")) for e in own])
    there = times > 0
    rate = np.where(there, h[:, None] / np.where(there, times, 1.0), 0.0)
    for j in range(2):
        a[:, first + j, first + j] = -rate[:, j]
    a[:, first, y], a[:, first, mount] = rate[:, 0], -rate[:, 0]
    # Without a first pole the second one reads directly.
    fed = there[:, 0]
    a[:, first + 1, first] = rate[:, 1] * fed
    a[:, first + 1, y], a[:, first + 1, mount] = rate[:, 1] * ~fed, -rate[:, 1] * ~fed
    return there


def _readings(end: np.ndarray, there: np.ndarray, mount: int, y: int, first: int) -> np.ndarray:
    """Rows of mount, mount_v, z1, z2 at the end; an absent pole shows what comes before it."""
    direct = end[:, y] - end[:, mount]
    z1 = np.where(there[:, :1], end[:, first], direct)
    z2 = np.where(there[:, 1:], end[:, first + 1], z1)
    return np.stack([end[:, mount], end[:, mount + 1], z1, z2], axis=1)


@dataclass(frozen=True)
class _Maps:
    """One step from (x1, x2, branches, old command, new command): nodes (n, 3, .) of the current that pulls, next x1,
    x2 and branches (n, 2 + BRANCHES, .), and where a unit of that current, as an acceleration, takes the mover, its
    velocity (n, 2, .), mount, mount_v, z1, z2 (n, 4, .)."""

    nodes: np.ndarray
    ahead: np.ndarray
    motion: np.ndarray
    seen: np.ndarray


def _maps(driving: Sequence[Experiment], seeing: Sequence[Experiment], h: np.ndarray, switch: np.ndarray) -> _Maps:
    """Maps of the actuators of `driving` and the probes of `seeing`; the command changes at a share of the step."""
    n, lanes = len(h), np.arange(len(h))
    times = np.array([(e.rig.amplifier_time_constant, effect_value(e.effects, "amplifier_lag")) for e in driving])
    there = times > 0
    rate = np.where(there, h[:, None] / np.where(there, times, 1.0), 0.0)
    before = np.where(there[:, 0], _X1, _U)
    coil = np.where(there[:, 1], _X2, before)  # the state that is the coil's current
    direct, weights, rates = eddy_branches(_values(driving, "eddy_current"), _values(driving, "eddy_current", "order"))
    a = np.zeros((n, _STATES, _STATES))
    a[:, _X1, _X1], a[:, _X1, _U] = -rate[:, 0], rate[:, 0]
    a[:, _X2, _X2] = -rate[:, 1]
    a[lanes, _X2, before] += rate[:, 1]
    for k in range(BRANCHES):
        a[:, _E + k, _E + k] = -rates[:, k] * h
        a[lanes, _E + k, coil] = rates[:, k] * h
    pulls = np.zeros((n, _STATES))
    pulls[lanes, coil] = direct
    pulls[:, _E:_U] = weights
    a[:, _V], a[:, _Y, _V], a[:, _M, _MV] = pulls, 1.0, 1.0
    a[:, _MV] = -_put_mount(a, seeing, h, _M)[:, None] * pulls + a[:, _MV]
    z = _put_probe(a, seeing, h, _M, _Y, _Z1)
    end = switched(a, switch, np.ones(n), _U)
    short = _U + 1
    middle = switched(a[:, :short, :short], np.minimum(switch, 0.5), np.full(n, 0.5), _U)
    mean, moment = end[:, _V], 2 * end[:, _Y]
    # Without a pole the current itself may jump inside the step: its mean stands for the middle.
    c1 = np.where(there.any(axis=1)[:, None], np.einsum("ni,nij->nj", pulls[:, :short], middle), mean)
    c0 = 3 * moment - 2 * c1
    ahead = end[:, : _E + BRANCHES].copy()
    # An absent pole follows what comes before it.
    ahead[:, _X1] = np.where(there[:, :1], end[:, _X1], end[:, _U])
    ahead[:, _X2] = np.where(there[:, 1:], end[:, _X2], ahead[:, _X1])
    nodes = np.stack([c0, c1, 6 * mean - 4 * c1 - c0], axis=1)
    return _Maps(nodes, ahead, end[:, [_Y, _V]], _readings(end, z, _M, _Y, _Z1))


def _bend(maps: _Maps, probe: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """What mount, mount_v, z1, z2 gain over the smooth motion that `_probe` takes from both its ends: (n, 4, .)."""
    # From rest the acceleration moves and speeds the mover just as far as it comes.
    smooth = (probe[:, :, 4:6] + probe[:, :, 8:]) @ maps.motion
    return pull[:, None, None] * (maps.seen - smooth)
