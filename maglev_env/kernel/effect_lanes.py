"""Exact discretisations of flexible lanes as rows of the kernel; absent effects get values that change nothing."""

import numpy as np

from maglev_env.kernel.exact_flexible import bend, current_maps, probe_map
from maglev_env.loop import actuator, saturation
from maglev_env.loop.amplifier import NEXT, NODES
from maglev_env.loop.eddy import BRANCHES, EDDY_COMMANDS, EDDY_NEXT, EDDY_NODES
from maglev_env.loop.effect import EFFECTS
from maglev_env.loop.sensor import (
    BEND,
    BESIDE,
    CROSS_BEND,
    CUBIC,
    FURTHER_BEND,
    FURTHER_CROSS,
    FURTHER_NEXT,
    FURTHER_SEEN,
    MOUNT_BEND,
    MOUNT_CROSS,
    MOUNT_NEXT,
    MOUNT_SEEN,
    UNFELT,
)
from maglev_env.loop.system import Values
from maglev_lanes.layout import LaneRows

# These effects select the flexible kernel, even with neutral values.
FLEXIBLE = tuple(name for name, card in EFFECTS.items() if card.flexible)
_X1, _X2, _E, _U = 0, 1, 2, 2 + BRANCHES  # what the maps of the current take: x1, x2, branches, both commands
_CARRIED = [_X1, _X2, _U, _U + 1]


def write_flexible(x: LaneRows, values: Values, h: np.ndarray, switch: np.ndarray) -> None:
    """Write the exact chains of one axis for a substep.

    Args:
        x: written.
        values: of its lanes.
        h: integration steps, s, (n,).
        switch: times at which the new command begins to act, s, (n,).
    """
    through, _ = saturation.slopes(values)
    gain_scale, pull = actuator.current_scale(values), through * actuator.central_tangent(values)[0] / values.mass
    probe, maps = probe_map(values, h), current_maps(values, values, h, switch / h)
    own, further = [2, 3, 6, 7], [4, 5, 6, 7]
    x[MOUNT_NEXT], x[MOUNT_SEEN] = _rows(probe[:, :2, own]), _rows(probe[:, 2:4, own])
    x[FURTHER_NEXT], x[FURTHER_SEEN] = _rows(probe[:, 4:, further]), _rows(probe[:, 2:4, 4:6])
    x[UNFELT] = 1 - values.effect("sensor_resonance", "support_share")
    x[BESIDE] = values.effect("sensor_resonance", "outside_share")
    x[CUBIC] = _rows(probe[:, 2:4, [0, 1, 8, 9, 10, 11]])
    nodes, bent = maps.nodes * gain_scale[:, None, None], bend(maps, probe, pull * h**2)
    x[NODES], x[EDDY_NODES] = _rows(nodes[:, :, _CARRIED]), _rows(nodes[:, :, _E:_U].swapaxes(1, 2))
    x[NEXT], x[EDDY_COMMANDS] = _rows(maps.ahead[:, :_E, _CARRIED]), _rows(maps.ahead[:, _E:, _U:])
    x[EDDY_NEXT] = _rows(np.stack([maps.ahead[:, _E + k, [_X1, _X2, _E + k]] for k in range(BRANCHES)], axis=1))
    x[MOUNT_BEND], x[BEND], x[FURTHER_BEND] = _carried(bent)


def write_flexible_cross(
    x: LaneRows, pull: np.ndarray, driving: Values, seeing: Values, h: np.ndarray, switch: np.ndarray
) -> None:
    """Write the coefficients of the other axis' current for the probe; pull: m/s2 per ampere, (n,)."""
    bent = bend(current_maps(driving, seeing, h, switch / h), probe_map(seeing, h), pull * h**2)
    x[MOUNT_CROSS], x[CROSS_BEND], x[FURTHER_CROSS] = _carried(bent)


def _carried(bent: np.ndarray) -> list[np.ndarray]:
    """Rows for the mount, for the probe and for the mount's further mode, of what is carried to them."""
    return [_rows(bent[:, at : at + 2, _CARRIED]) for at in (0, 2, 4)]


def _rows(maps: np.ndarray) -> np.ndarray:
    """Maps (n, to, from) as rows (to from, n)."""
    return maps.reshape(len(maps), -1).T
