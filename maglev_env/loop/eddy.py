"""Eddy currents: the fractional lag of solid iron, approximated by a few first-order branches.

The transfer function from the coil's current to the force-producing one is 1 / (1 + (s / w)^order); order 1/2 is thick
solid iron (Zhu, Knospe and Maslen 2005, IEEE Trans. Magn. 41). Iron of a finite depth is magnetised throughout at low
frequency: there (s / w)^order is multiplied by ((z coth z - 1) / z)^(2 - 2 order) with z^2 = s / (2 pi depth_hz), which
makes it a first-order lag (Stoll 1974, a plate with flux on both sides). A fractional lag has no finite set of states,
but the branches have, so that the kernel and the linear loop can simulate them.
"""

from collections.abc import Mapping
from functools import lru_cache
from math import inf

import numpy as np

from maglev_env.loop import amplifier
from maglev_env.loop.amplifier import X1, X2
from maglev_env.loop.card import EffectCard, Parameter
from maglev_env.loop.system import System, Values
from maglev_lanes.layout import LANES as W
from maglev_lanes.layout import rows_after
from maglev_lanes.pieces import piece

EFFECTS: Mapping[str, EffectCard] = {
    "eddy_current": EffectCard(
        "actuator",
        {
            "corner_hz": Parameter("Hz", 1.0, 1e6, absent=inf, starts=(1e3, 1e4, 1e5)),
            "order": Parameter("", 0.3, 0.98, 0.5, scale=0.1, starts=(0.5, 0.85)),
            "depth_hz": Parameter("Hz", 0.0, 1e4, 0.0, shape=2.0, centre=1.0),
        },
        "current reaches the force through 1 / (1 + (s / w)^order): solid iron, order 1/2 (Zhu et al. 2005); below "
        "depth_hz the iron is magnetised throughout, and lags by first order",
        "current, force and displacement",
        ("magnets",),
        flexible=True,
        form_share=0.005,
        plain_kernel=("depth_hz",),
    ),
}
BRANCHES = 8
LOW, HIGH = 0.9, 2200.0  # Hz: band in which the branches are fitted
STATES = tuple(f"eddy{k}" for k in range(BRANCHES))
_FIT = np.geomspace(LOW, HIGH, 100)


def eddy_branches(
    corner_hz: float | np.ndarray, order: float | np.ndarray, depth_hz: float | np.ndarray = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First-order branches that approximate fractional lags.

    With branches x' = rate (i - x), the force-producing current is direct i + sum weights x, and
    direct + sum weights = 1. From 1 Hz to 2 kHz the result is within 0.3 % and 0.2 degrees of the fractional lag, for
    corners from 50 Hz and orders 0.3 .. 0.98; for lower corners and above 2 kHz, within a few per cent and degrees.
    With a depth, by which the branches are not placed, it is within 7 % and 4 degrees, and for corners from 1 kHz
    within 2 % and 1 degree. It is a smooth function of corner, order and depth.

    Args:
        corner_hz: Hz; any shape (...). Infinite: no lag, which gives direct 1 and weights 0.
        order: same shape.
        depth_hz: same shape; 0: iron of infinite depth.

    Returns:
        Direct share (...), weights (..., BRANCHES) and rates (..., BRANCHES) in 1/s.
    """
    corner, a, depth = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (corner_hz, order, depth_hz)))
    finite = np.isfinite(corner)
    hz = _poles(np.where(finite, corner, HIGH), a)
    # Only the weights are unknown: 1 - sum weights j f / (j f + pole) is 1 at zero frequency for any weights.
    s = 1j * _FIT
    lagging = (s / corner[..., None]) ** a[..., None]
    if depth.any():
        lagging = lagging * _filled(s, depth[..., None]) ** (2 - 2 * a[..., None])
    bent = 1 + lagging  # one over the response; makes the errors of the fit relative
    matrix = -(s[:, None] / (s[:, None] + hz[..., None, :])) * bent[..., None]
    wanted = 1 - bent
    q, r = np.linalg.qr(np.concatenate([matrix.real, matrix.imag], axis=-2))
    right = np.concatenate([wanted.real, wanted.imag], axis=-1)[..., None]
    weights = np.linalg.solve(r, np.swapaxes(q, -1, -2) @ right)[..., 0]
    weights = np.where(finite[..., None], weights, 0.0)
    return 1 - weights.sum(axis=-1), weights, 2 * np.pi * hz


def _filled(s: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """(z coth z - 1) / z with z^2 = s / depth; both in Hz; 1 where the depth is 0."""
    z = np.sqrt(s / np.where(depth > 0, depth, 1.0))
    low = abs(z) < 1e-2
    z = np.where(low, 1.0, z)
    found = 1 / np.tanh(z) - 1 / z
    return np.where(depth > 0, np.where(low, np.sqrt(s / np.where(depth > 0, depth, 1.0)) / 3, found), 1.0)


def _poles(corner: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Corner frequencies (..., BRANCHES), Hz, of the branches.

    The fractional lag is a continuum of poles with a logistic density in log frequency, which narrows to one pole at
    order 1. So the poles are spaced logarithmically far from the corner, and the closer together near it, the closer
    the order is to 1. The constants were optimised for the smallest maximum error.
    """
    width, high = 6.2 * (1 - order) ** 0.68, 4600.0
    low = 1 / (np.exp(-6.2 * order) / 0.0066 + 2 / corner)
    ends = np.arcsinh(np.log(np.stack([low, np.broadcast_to(high, low.shape)]) / corner) / width)
    along = ends[0, ..., None] + (ends[1] - ends[0])[..., None] * np.linspace(0, 1, BRANCHES)
    return corner[..., None] * np.exp(width[..., None] * np.sinh(along))


@lru_cache(64)
def _remembered(corner_hz: bytes, order: bytes, depth_hz: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The branches of arrays given as bytes; cached, because the lanes of many recordings share their effect."""
    return eddy_branches(*map(np.frombuffer, (corner_hz, order, depth_hz)))


def pulling_current(system: System, values: Values, current: np.ndarray) -> np.ndarray:
    """Signal of the force-producing current (A): the coil's current (a signal, A) after the branches."""
    corner, order, depth = (values.effect("eddy_current", key) for key in (None, "order", "depth_hz"))
    if system.without(STATES, there := np.isfinite(corner)):
        return current
    direct, weights, rates = _remembered(corner.tobytes(), order.tobytes(), depth.tobytes())
    branches = system.signals(STATES)
    rates = (rates * system.step[:, None])[:, :, None] * (current[:, None] - branches)
    system.put_all(STATES, rates, there)
    return direct[:, None] * current + (weights[:, None] @ branches)[:, 0]


# Rows of a lane. EDDY: currents of the branches, A. EDDY_NODES: coefficients of each branch in the three nodal
# currents. EDDY_NEXT: coefficients of x1, x2 and the branch itself for its value at the end of the step;
# EDDY_COMMANDS: those of the old and the new command.
EDDY, EDDY_NODES, EDDY_NEXT, EDDY_COMMANDS, END = rows_after(
    amplifier.END,
    f"EDDY[{BRANCHES}] EDDY_NODES[{3 * BRANCHES}] EDDY_NEXT[{3 * BRANCHES}] EDDY_COMMANDS[{2 * BRANCHES}]",
)


@piece
def eddy_node(x, k, node):
    """Contribution of the branches to the nodal current at row `node` (0, 1 or 2 times W), A."""
    total = 0.0
    for j in range(BRANCHES):
        total = total + x[k + EDDY_NODES + node + 3 * j * W] * x[k + EDDY + j * W]
    return total


@piece
def store_eddy(x, k, old, new):
    """Advance the branches to the end of the step, with the old and the new command (A)."""
    x1, x2 = x[k + X1], x[k + X2]
    for j in range(BRANCHES):
        n, c = k + EDDY_NEXT + 3 * j * W, k + EDDY_COMMANDS + 2 * j * W
        branch = x[n] * x1 + x[n + W] * x2 + x[n + 2 * W] * x[k + EDDY + j * W]
        x[k + EDDY + j * W] = branch + x[c] * old + x[c + W] * new
    return 0.0
