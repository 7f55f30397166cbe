"""Springs that are not straight lines: a hardening one, and a soft stop that is met before the clearance."""

from collections.abc import Mapping
from math import inf

import numpy as np

from maglev_env.loop.card import EffectCard, Parameter
from maglev_env.loop.further import uneven_gain
from maglev_env.loop.mechanics import PER_MASS
from maglev_env.loop.system import Values
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

PUSHED = 30.0  # m/s2, three times the weight: what is taken to push the mover into a spring of which it needs much
PLAY = 0.02  # share of the motion within which a stop leaves the rotor alone: one that always touches is a spring
STIFFEST = 1.0  # rad that the mover may turn by on a spring in one step

EFFECTS: Mapping[str, EffectCard] = {
    "cubic_spring": EffectCard(
        "mechanics",
        {
            "coefficient": Parameter(
                "N/m^3", 1.0, 1e20, absent=0.0, starts=tuple(np.geomspace(1e15, 1e6, 10)), in_proportion=True
            )
        },
        "a spring whose force grows with the cube of the displacement (Duffing): flexures and membranes harden",
        "force and displacement at two amplitudes or static offsets",
        flexible=True,
        linear=False,
        form_share=0.02,
        describes=True,
    ),
    "soft_stop": EffectCard(
        "mechanics",
        {
            "distance": Parameter(
                "m", 1e-9, 0.1, absent=inf, starts=tuple(np.geomspace(3e-6, 3e-3, 7)), of_motion=PLAY
            ),
            "stiffness": Parameter("N/m", 1e-3, 1e12, 1e5, starts=(30.0, 1e3, 1e5), in_proportion=True),
            # 1 is a spring, 1.5 a round body on a flat one (Hertz), 2 a tip or rubber that is squeezed.
            "steepness": Parameter("", 1.0, 4.0, 1.0, shape=0.4, centre=1.4),
            "side": Parameter("", -1.0, 1.0, 0.0, scale=1.0, shape=0.7),
        },
        "beyond this distance from the centre a spring pushes back: a bumper, a seal, a cable; in another form by "
        "stiffness * depth * (depth / distance)^(steepness - 1), on the lower side 1 - side times as much, or on the "
        "upper one 1 + side of a negative side",
        "force and displacement at two amplitudes or static offsets",
        flexible=True,
        linear=False,
        like="cubic_spring",
        form_share=0.05,
        describes=True,
    ),
}

# Rows of a lane. CUBE: acceleration per m^3. REACH: distance of the stop, m; STOP: acceleration per m beyond it;
# STEEPER: its steepness less 1; ABOVE, BELOW: shares of it on either side.
CUBE, REACH, STOP, STEEPER, ABOVE, BELOW, END = rows_after(uneven_gain.END, "CUBE REACH STOP STEEPER ABOVE BELOW")


def fill(x: LaneRows, values: Values, h: np.ndarray, axis: int) -> None:
    """Write the constants; the mechanics' rows must have been written."""
    # A spring that is too stiff for the step would throw the mover out, so it is as soft as the step needs. Where it
    # holds PUSHED, the mover swings on it at a rate that grows with the sixth root of its coefficient.
    turn = np.maximum(_cube_rate(values) * h / STIFFEST, 1.0)
    x[CUBE] = values.effect("cubic_spring") * x[PER_MASS] / turn**6
    x[REACH], x[STEEPER] = values.effect("soft_stop"), values.effect("soft_stop", "steepness") - 1
    side = values.effect("soft_stop", "side")
    x[ABOVE], x[BELOW] = 1 + np.minimum(side, 0.0), 1 - np.maximum(side, 0.0)
    turn = np.maximum(_stop_rate(values) * h / STIFFEST, 1.0)
    x[STOP] = values.effect("soft_stop", "stiffness") * x[PER_MASS] / turn ** (2 * (1 + x[STEEPER]))


def spring_rate(values: Values) -> np.ndarray:
    """Rate (rad/s) at which the mover swings on the springs where they hold PUSHED, or beside the centre, (n,)."""
    return np.maximum(_cube_rate(values), _stop_rate(values))


def _cube_rate(values: Values) -> np.ndarray:
    """That of the cubic spring alone."""
    cube = values.effect("cubic_spring") / values.mass
    way = np.minimum(np.cbrt(PUSHED / np.maximum(cube, 1e-99)), values.rig("clearance"))
    return np.sqrt(3 * cube) * way


def _stop_rate(values: Values) -> np.ndarray:
    """That of the stop alone; 0 without one."""
    reach, stiffness, power = (values.effect("soft_stop", key) for key in ("distance", "stiffness", "steepness"))
    met = reach < values.rig("clearance")
    reach = np.where(met, reach, 1.0)
    way = reach * (PUSHED * values.mass / (stiffness * reach)) ** (1 / power)
    return np.where(met, np.sqrt(power * PUSHED / way), 0.0)


@piece
def pushed_back(x, k, y):
    """Deceleration by the springs at the displacement y."""
    reach = x[k + REACH]
    beyond = max(y - reach, 0.0) + min(y + reach, 0.0)
    return x[k + CUBE] * (y * y * y) + x[k + STOP] * beyond


@piece
def pushed_back_shaped(x, k, y):
    """The same with a stop that need not be a straight line, nor the same on both sides."""
    reach = x[k + REACH]
    beyond = max(y - reach, 0.0) + min(y + reach, 0.0)
    steeper = (abs(beyond) / reach) ** x[k + STEEPER]
    share = x[k + ABOVE] if y > 0.0 else x[k + BELOW]
    return x[k + CUBE] * (y * y * y) + x[k + STOP] * beyond * steeper * share
