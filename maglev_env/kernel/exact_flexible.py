"""Exact discretisation of flexible lanes, which always have eddy currents, the probe's mount and a second body.

The order of the states is that of the blocks: x1 and x2 of the amplifier, the branches, then the four of the sensor:
mount, its velocity, z1 and z2, and the further mode of the mount. The unit of time is that of `exact`.
"""

from dataclasses import dataclass

import numpy as np

from maglev_env.kernel.exact import CUBIC, HERMITE, nodal, switched
from maglev_env.loop import amplifier, bodies, eddy, sensor
from maglev_env.loop.system import System, Values
from maglev_lanes.matrix_exponential import expm

CARRIED = (*amplifier.STATES, *eddy.STATES)  # from the command to the current that pulls
_CURRENT = (*CARRIED, "command", "impulse", "displacement", *sensor.STATES)


@dataclass(frozen=True)
class CurrentMaps:
    """One step from (x1, x2, branches, old command, new command).

    Args:
        nodes: (n, 3, .), nodal currents (see `exact.nodal`) of the force-producing current.
        ahead: (n, 2 + BRANCHES, .), x1, x2 and branches at the end of the step.
        motion: (n, 2, .), position and velocity of the mover at the end, if that current were its acceleration.
        seen: (n, 6, .), mount, mount_v, z1, z2, further mount, its velocity at the end of the step.
    """

    nodes: np.ndarray
    ahead: np.ndarray
    motion: np.ndarray
    seen: np.ndarray


def current_maps(driving: Values, seeing: Values, h: np.ndarray, switch: np.ndarray) -> CurrentMaps:
    """Maps of the actuators of `driving` and the probes of `seeing`; the command changes at a share of the step."""
    n = len(h)
    system = System(_CURRENT, h)
    pulls = eddy.pulling_current(system, driving, amplifier.coil_current(system, driving, system.signal("command")))
    system.put("impulse", pulls)
    system.integrate(("displacement", "impulse"))
    sensor.reading(system, seeing, system.signal("displacement"), pulls)
    command, impulse, displacement = system.at("command", "impulse", "displacement")
    end = switched(system.a, switch, np.ones(n), command)
    short = command + 1
    halfway = switched(system.a[:, :short, :short], np.minimum(switch, 0.5), np.full(n, 0.5), command)
    lagged = system.there[:, system.at(*amplifier.STATES)].any(axis=1)
    middle = np.where(lagged[:, None], np.einsum("ni,nij->nj", pulls[:, :short], halfway), end[:, impulse])
    return CurrentMaps(
        nodes=nodal(end[:, impulse], end[:, displacement], middle),
        ahead=system.shown[:, system.at(*CARRIED)] @ end,
        motion=end[:, [displacement, impulse]],
        seen=system.shown[:, system.at(*sensor.STATES)] @ end,
    )


def probe_map(values: Values, h: np.ndarray) -> np.ndarray:
    """Mount, its velocity, z1, z2, its further mode and the velocity of that at the end of a step.

    y is the cubic through both ends. The bearing's acceleration, which moves the mount, is taken as linear in time; it
    changes the mover's position by `moved` and its velocity by `pushed`.

    Returns:
        Coefficients of (z1, z2, mount, mount_v, further, further_v, moved, pushed, y0, h v0, y1, h v1), (n, 6, 12).
    """
    acceleration = ("acceleration", "acceleration'")
    system = System((*sensor.STATES, *CUBIC, *acceleration), h)
    system.integrate(CUBIC)
    system.integrate(acceleration)
    sensor.reading(system, values, system.signal("y"), system.signal("acceleration"))
    end = system.shown[:, system.at(*sensor.STATES)] @ expm(system.a)
    cubic = end[:, :, 6:10] @ HERMITE
    linear = end[:, :, 10:] @ np.array([[6, -2], [-12, 6]])
    return np.concatenate([end[:, :, 2:4], end[:, :, :2], end[:, :, 4:6], linear, cubic], axis=2)


def bend(maps: CurrentMaps, probe: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Corrections of the states of `probe_map` to the smooth motion that it assumes, (n, 6, .)."""
    # The mover starts at rest here, so that its motion at the end is the change by the acceleration.
    smooth = (probe[:, :, 6:8] + probe[:, :, 10:]) @ maps.motion
    return pull[:, None, None] * (maps.seen - smooth)


def body_maps(values: Values, h: np.ndarray, further: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The B bodies on the mover, relative to it, under the mover's acceleration by other forces; zeros without one.

    Args:
        values: of the lanes.
        h: integration steps, s, (n,).
        further: whether there is a further body beside the second one.

    Returns:
        Their states (position and velocity of each) in the middle of the step from (states, acceleration),
        (n, 2 B, 2 B + 1); at the end from the states, (n, 2 B, 2 B), and what the accelerations at the start, in the
        middle and at the end add there, (n, 2 B, 3): a parabola through the three.
    """
    parabola = ("acceleration", "acceleration'", "acceleration''")
    names = (*bodies.BODY, *bodies.FURTHER)[: 4 if further else 2]
    size = len(names)
    system = System((*names, *parabola), h)
    system.integrate(parabola)
    bodies.with_bodies(system, values, system.signal("acceleration"), further)
    there = system.there[:, :size, None]
    middle, end = (there * expm(system.a * span)[:, :size] for span in (0.5, 1.0))
    nodes = np.array([[1, 0, 0], [-3, 4, -1], [4, -8, 4]])  # value, slope, bend at the start from the three nodes
    return middle[:, :, : size + 1], end[:, :, :size], end[:, :, size:] @ nodes
