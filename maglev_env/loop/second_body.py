"""The second body of effect support_resonance, beside the mechanics' block: its rows and its pieces of the kernel.

The common centre of mass of mover and second body moves like a free mass. The second body relative to the mover is an
oscillator, driven by the mover's acceleration by all other forces. For a given acceleration at the three nodes of a
step, both motions are computed exactly.
"""

import numpy as np

from maglev_env.loop import mechanics
from maglev_env.loop.bodies import mass_ratios
from maglev_env.loop.system import Values
from maglev_lanes.layout import LANES as W
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

# BODY_Y, BODY_V: motion relative to the mover. BODY_SHARE, MOVER_SHARE: shares of the total mass. TO_MIDDLE:
# coefficients of (position, velocity, acceleration) for the middle of the step; TO_END: those of (position, velocity)
# for its end; BY_NODES: those of the accelerations at the three nodes for its end.
BODY_Y, BODY_V, BODY_SHARE, MOVER_SHARE, TO_MIDDLE, TO_END, BY_NODES, END = rows_after(
    mechanics.END, "BODY_Y BODY_V BODY_SHARE MOVER_SHARE TO_MIDDLE[6] TO_END[4] BY_NODES[6]"
)
SIXTH = 1.0 / 6.0


def fill(x: LaneRows, values: Values, maps: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """Write the shares of the mass, and the second body's maps (see `maglev_env.kernel.exact_flexible.body_maps`)."""
    ratio, _ = mass_ratios(values)
    x[BODY_SHARE], x[MOVER_SHARE] = ratio / (1 + ratio), 1 / (1 + ratio)
    x[TO_MIDDLE], x[TO_END], x[BY_NODES] = (part.reshape(len(ratio), -1).T for part in maps)


@piece
def mass_velocity(x, k, v):
    """Velocity of the centre of mass of both bodies."""
    return v + x[k + BODY_SHARE] * x[k + BODY_V]


@piece
def y_middle(x, k, y, v, a):
    r, q = x[k + BODY_Y], k + TO_MIDDLE
    body = x[q] * r + x[q + W] * x[k + BODY_V] + x[q + 2 * W] * a
    return y + 0.5 * mass_velocity(x, k, v) + 0.125 * (x[k + MOVER_SHARE] * a) - x[k + BODY_SHARE] * (body - r)


@piece
def v_middle(x, k, v, a):
    q = k + TO_MIDDLE + 3 * W
    body_v = x[q] * x[k + BODY_Y] + x[q + W] * x[k + BODY_V] + x[q + 2 * W] * a
    return mass_velocity(x, k, v) + 0.5 * (x[k + MOVER_SHARE] * a) - x[k + BODY_SHARE] * body_v


@piece
def y_end(x, k, y, v, a):
    return y + mass_velocity(x, k, v) + 0.5 * (x[k + MOVER_SHARE] * a) - gone(x, k, a, a, a)


@piece
def v_end(x, k, v, a):
    return mass_velocity(x, k, v) + x[k + MOVER_SHARE] * a - x[k + BODY_SHARE] * body_v_next(x, k, a, a, a)


@piece
def y_next(x, k, y, v, a1, am, a4):
    mass = y + mass_velocity(x, k, v) + x[k + MOVER_SHARE] * ((a1 + 2.0 * am) * SIXTH)
    return mass - gone(x, k, a1, am, a4)


@piece
def v_next(x, k, v, a1, am, a4):
    mass = mass_velocity(x, k, v) + x[k + MOVER_SHARE] * ((a1 + 4.0 * am + a4) * SIXTH)
    return mass - x[k + BODY_SHARE] * body_v_next(x, k, a1, am, a4)


@piece
def body_y_next(x, k, a1, am, a4):
    """Position of the second body relative to the mover at the end of the step."""
    q, n = k + TO_END, k + BY_NODES
    return x[q] * x[k + BODY_Y] + x[q + W] * x[k + BODY_V] + x[n] * a1 + x[n + W] * am + x[n + 2 * W] * a4


@piece
def body_v_next(x, k, a1, am, a4):
    """Velocity of the second body relative to the mover at the end of the step."""
    q, n = k + TO_END + 2 * W, k + BY_NODES + 3 * W
    return x[q] * x[k + BODY_Y] + x[q + W] * x[k + BODY_V] + x[n] * a1 + x[n + W] * am + x[n + 2 * W] * a4


@piece
def gone(x, k, a1, am, a4):
    """Change, within the step, of the mover's distance from the common centre of mass."""
    return x[k + BODY_SHARE] * (body_y_next(x, k, a1, am, a4) - x[k + BODY_Y])


@piece
def store_body(x, k, a1, am, a4):
    y, v = body_y_next(x, k, a1, am, a4), body_v_next(x, k, a1, am, a4)
    x[k + BODY_Y], x[k + BODY_V] = y, v
    return 0.0
