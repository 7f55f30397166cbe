"""Two bodies on the rotor, of the form of support_resonance that has a further one: rows and pieces of the kernel.

As with one (`second_body`), the common centre of mass moves like a free mass, and all bodies relative to the mover are
a linear system that the mover's acceleration by all other forces drives. SHARES weigh the bodies' positions and
velocities by their parts of the total mass.
"""

import numpy as np

from maglev_env.loop import second_body
from maglev_env.loop.bodies import mass_ratios
from maglev_env.loop.system import Values
from maglev_lanes.layout import LANES as W
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

# BODIES: position and velocity of each, relative to the mover. ALONE: the mover's share of the total mass. WEIGHED:
# coefficients of (BODIES, acceleration) for the weighed position and velocity in the middle of the step. AHEAD:
# coefficients of (BODIES, accelerations at the three nodes) for each of BODIES at its end.
BODIES, SHARES, ALONE, WEIGHED, AHEAD, END = rows_after(
    second_body.END, "BODIES[4] SHARES[2] ALONE WEIGHED[10] AHEAD[28]"
)
SIXTH = 1.0 / 6.0


def fill(x: LaneRows, values: Values, maps: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """Write the shares of the mass and the maps of both bodies (`maglev_env.kernel.exact_flexible.body_maps`)."""
    ratios = np.stack(mass_ratios(values))
    whole = 1 + ratios.sum(axis=0)
    middle, end, nodes = maps
    x[SHARES], x[ALONE] = ratios / whole, 1 / whole
    positions, velocities = (np.einsum("in,nij->nj", ratios / whole, middle[:, at::2]) for at in (0, 1))
    x[WEIGHED] = np.concatenate([positions, velocities], axis=1).T
    x[AHEAD] = np.concatenate([end, nodes], axis=2).reshape(len(whole), -1).T


@piece
def shifted(x, k):
    """Distance of the mover from the common centre of mass."""
    return x[k + SHARES] * x[k + BODIES] + x[k + SHARES + W] * x[k + BODIES + 2 * W]


@piece
def mass_velocity(x, k, v):
    """Velocity of the centre of mass of all bodies."""
    return v + x[k + SHARES] * x[k + BODIES + W] + x[k + SHARES + W] * x[k + BODIES + 3 * W]


@piece
def weighed(x, k, row, a):
    """A weighed number in the middle of the step at a constant acceleration."""
    total = x[k + row + 4 * W] * a
    for j in range(4):
        total = total + x[k + row + j * W] * x[k + BODIES + j * W]
    return total


@piece
def ahead(x, k, body, a1, am, a4):
    """Number `body` of BODIES at the end of the step."""
    n = k + AHEAD + 7 * body * W
    total = x[n + 4 * W] * a1 + x[n + 5 * W] * am + x[n + 6 * W] * a4
    for j in range(4):
        total = total + x[n + j * W] * x[k + BODIES + j * W]
    return total


@piece
def y_middle(x, k, y, v, a):
    mass = y + 0.5 * mass_velocity(x, k, v) + 0.125 * (x[k + ALONE] * a)
    return mass - (weighed(x, k, WEIGHED, a) - shifted(x, k))


@piece
def v_middle(x, k, v, a):
    return mass_velocity(x, k, v) + 0.5 * (x[k + ALONE] * a) - weighed(x, k, WEIGHED + 5 * W, a)


@piece
def y_end(x, k, y, v, a):
    return y + mass_velocity(x, k, v) + 0.5 * (x[k + ALONE] * a) - gone(x, k, a, a, a)


@piece
def v_end(x, k, v, a):
    return mass_velocity(x, k, v) + x[k + ALONE] * a - going(x, k, a, a, a)


@piece
def y_next(x, k, y, v, a1, am, a4):
    mass = y + mass_velocity(x, k, v) + x[k + ALONE] * ((a1 + 2.0 * am) * SIXTH)
    return mass - gone(x, k, a1, am, a4)


@piece
def v_next(x, k, v, a1, am, a4):
    mass = mass_velocity(x, k, v) + x[k + ALONE] * ((a1 + 4.0 * am + a4) * SIXTH)
    return mass - going(x, k, a1, am, a4)


@piece
def gone(x, k, a1, am, a4):
    """Change, within the step, of the mover's distance from the common centre of mass."""
    first, further = ahead(x, k, 0, a1, am, a4), ahead(x, k, 2, a1, am, a4)
    return x[k + SHARES] * first + x[k + SHARES + W] * further - shifted(x, k)


@piece
def going(x, k, a1, am, a4):
    """Rate of that distance at the end of the step."""
    first, further = ahead(x, k, 1, a1, am, a4), ahead(x, k, 3, a1, am, a4)
    return x[k + SHARES] * first + x[k + SHARES + W] * further


@piece
def store_body(x, k, a1, am, a4):
    r1, v1 = ahead(x, k, 0, a1, am, a4), ahead(x, k, 1, a1, am, a4)
    r2, v2 = ahead(x, k, 2, a1, am, a4), ahead(x, k, 3, a1, am, a4)
    x[k + BODIES], x[k + BODIES + W] = r1, v1
    x[k + BODIES + 2 * W], x[k + BODIES + 3 * W] = r2, v2
    return 0.0
