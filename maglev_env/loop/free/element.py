"""A free correction as a formula: a broken line through given values, and linear and hysteretic memory of its input.

    f(v) = line(v) + (direct + rate t) v + sum g_k m_k + sum h_k p_k

m_k are relaxations T_k dm/dt = v - m (a Prony series), p_k play operators (a Prandtl-Ishlinskii model; M.
Krasnosel'skii and A. Pokrovskii, Systems with Hysteresis, 1989). All is linear in the values of the line, g and h.
"""

from collections.abc import Callable

import numpy as np

from maglev_env.loop.card import Parameter
from maglev_env.loop.system import Values
from maglev_lanes.layout import LANES as W
from maglev_lanes.layout import LaneRows
from maglev_lanes.pieces import piece

# Where the line has its values, on either side of zero, as shares of the range: denser where signals mostly are.
SHARES = (0.06, 0.2, 0.42, 0.7, 1.0)
HALF = len(SHARES)
LINE = (*(f"n{j}" for j in range(HALF, 0, -1)), *(f"p{j}" for j in range(1, HALF + 1)))
KNOTS = (*(-share for share in SHARES[-2::-1]), 0.0, *SHARES[:-1])  # where its slope changes
POLES, RATIO = 4, 5.0  # relaxations, and the ratio of their successive time constants
RELAXATIONS = tuple(f"g{k}" for k in range(POLES))
PLAYS = tuple(f"h{k}" for k in range(4))
WIDTHS = (0.05, 0.15, 0.35, 0.7)  # half widths of the plays, as shares of the range
# Rows of the line: the range, half of the change of its slope at each knot, its mean slope, and
# what makes it zero at zero; of the memory: states and weights of relaxations and plays, half widths, and the shares by
# which relaxations follow within half a step and a whole one, and the change of the direct part in a step.
LINE_ROWS, MEMORY_ROWS = 2 * HALF + 2, 7 * POLES + 1
_STATE, _PLAY, _G, _H, _WIDTH, _HALF_WAY, _WHOLE_WAY, _RATE = (POLES * W * j for j in range(8))
START, MIDDLE, END_OF_STEP = range(3)


def line_parameters(unit: str, low: float, high: float, of: str) -> dict[str, Parameter]:
    """The parameters of a line; low and high bound its values, in `unit`, over an input in the unit `of`."""
    return {"range": Parameter(of, 1e-12, 1e6, absent=1.0)} | {key: Parameter(unit, low, high, 0.0) for key in LINE}


def memory_parameters(unit: str, bound: float) -> dict[str, Parameter]:
    """The parameters of a memory, per unit of its input."""
    own = {key: Parameter(unit, -bound, bound, 0.0) for key in ("direct", *RELAXATIONS, *PLAYS)}
    rate = Parameter(f"{unit or 1}/s", -bound, bound, 0.0)
    return {"time": Parameter("s", 1e-7, 100.0, 1e-3), **own, "rate": rate}


def slopes(values: Values, name: str) -> tuple[np.ndarray, np.ndarray]:
    """The range (n,), and the slope of the line between each two of its values, (2 HALF, n)."""
    reach = values.effect(name)
    at = [values.effect(name, key) for key in LINE]
    points = np.array([*at[:HALF], np.zeros_like(reach), *at[HALF:]])
    return reach, np.diff(points, axis=0) / (np.diff([-1.0, *KNOTS, 1.0])[:, None] * reach)


def fill_line(
    x: LaneRows, first: int, values: Values, name: str, of: np.ndarray | float, per: np.ndarray | float, direct: bool
) -> None:
    """Write a line's rows.

    Args:
        x: Written.
        first: Its first row.
        values: Of the lanes.
        name: Of the effect.
        of: Factor on the input: what the kernel's number is per unit of the card.
        per: Factor on the line's values.
        direct: Whether the effect has a memory, whose direct part belongs to the line.
    """
    reach, slope = slopes(values, name)
    slope, reach = (slope + (values.effect(name, "direct") if direct else 0.0)) * (per / of), reach * of
    change = 0.5 * np.diff(slope, axis=0)
    at = abs(np.array(KNOTS))[:, None]
    x[first] = reach
    x[first + W] = change
    x[first + 2 * HALF * W] = 0.5 * (slope[0] + slope[-1])
    x[first + (2 * HALF + 1) * W] = -(change * at).sum(axis=0) * reach


def fill_memory(
    x: LaneRows,
    first: int,
    values: Values,
    name: str,
    of: np.ndarray | float,
    per: np.ndarray | float,
    dt: np.ndarray,
    h: np.ndarray,
) -> None:
    """Write a memory's rows, as `fill_line`; dt, h: time between two advances and integration step, s, (n,)."""
    scale = np.ones(dt.shape) * per / of
    x[first + _RATE] = values.effect(name, "rate") * scale * h
    for j, key in enumerate(RELAXATIONS):
        x[first + _G + j * W] = values.effect(name, key) * scale
        rate = dt / (values.effect(name, "time") * RATIO**j)
        x[first + _HALF_WAY + j * W], x[first + _WHOLE_WAY + j * W] = -np.expm1(-0.5 * rate), -np.expm1(-rate)
    for j, key in enumerate(PLAYS):
        x[first + _H + j * W] = values.effect(name, key) * scale
        x[first + _WIDTH + j * W] = WIDTHS[j] * values.effect(name) * of


@piece
def line(x, q, v):
    """The line whose rows start at q, at v."""
    reach = x[q]
    total = x[q + 2 * HALF * W] * v + x[q + (2 * HALF + 1) * W]
    for j in range(2 * HALF - 1):
        total += x[q + (1 + j) * W] * abs(v - KNOTS[j] * reach)
    return total


def memory(node: int) -> Callable:
    """A piece for what a memory (rows from q) adds at START, MIDDLE or END_OF_STEP, with v its input there.

    `advance` takes the input at the end of a step for that of the whole step, so relaxations are half a step early;
    they are read that much later.
    """
    at_end = node == END_OF_STEP

    @piece
    def added(x, q, v, steps):
        total = x[q + _RATE] * steps * v
        for j in range(POLES):
            m = x[q + _STATE + j * W]
            if at_end:
                m = m + (v - m) * x[q + _HALF_WAY + j * W]
            r = x[q + _WIDTH + j * W]
            total += x[q + _G + j * W] * m + x[q + _H + j * W] * min(max(x[q + _PLAY + j * W], v - r), v + r)
        return total

    return added


@piece
def advance(x, q, v, share):
    """Move a memory's states to the end of a step at which its input is v; with a share of 0 they stay."""
    for j in range(POLES):
        m, play, r = x[q + _STATE + j * W], x[q + _PLAY + j * W], x[q + _WIDTH + j * W]
        x[q + _STATE + j * W] = m + share * ((v - m) * x[q + _WHOLE_WAY + j * W])
        x[q + _PLAY + j * W] = play + share * (min(max(play, v - r), v + r) - play)
