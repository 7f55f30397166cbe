"""Eddy currents: the fractional lag of solid iron as a few first-order branches, which have states and poles.

1 / (1 + (s / w)^order) from the coil's current to the one that pulls; order 1/2 is thick solid iron (Zhu, Knospe and
Maslen 2005, IEEE Trans. Magn. 41).
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
        },
        "current reaches the force through 1 / (1 + (s / w)^order): solid iron, order 1/2 (Zhu et al. 2005)",
        "current, force and displacement",
        ("magnets",),
        flexible=True,
        form_share=0.005,
    ),
}
BRANCHES = 8
LOW, HIGH = 0.9, 2200.0  # Hz: where the branches are fitted
STATES = tuple(f"eddy{k}" for k in range(BRANCHES))
_FIT = np.geomspace(LOW, HIGH, 100)


def eddy_branches(
    corner_hz: float | np.ndarray, order: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Direct share (...), weights (..., BRANCHES) and rates (..., BRANCHES) 1/s, of corners (Hz) and orders (...).

    With branches x' = rate (i - x), the current that pulls is direct i + sum weights x, and direct + sum weights = 1.
    From 1 Hz to 2 kHz within 0.3 % and 0.2 degrees of the fractional lag for corners of 50 Hz and more and orders
    0.3 .. 0.98; with lower corners, and above 2 kHz, within some per cent and degrees. Smooth in both. An infinite
    corner gives direct 1 and weights 0.
    """
    corner, a = np.broadcast_arrays(np.asarray(corner_hz, dtype=float), np.asarray(order, dtype=float))
    finite = np.isfinite(corner)
    hz = _poles(np.where(finite, corner, HIGH), a)
    # Unknown are the weights alone: 1 - sum weights j f / (j f + pole) is 1 at zero frequency whatever they are.
    s = 1j * _FIT
    bent = 1 + (s / corner[..., None]) ** a[..., None]  # one over the response: makes the errors relative
    matrix = -(s[:, None] / (s[:, None] + hz[..., None, :])) * bent[..., None]
    wanted = 1 - bent
    q, r = np.linalg.qr(np.concatenate([matrix.real, matrix.imag], axis=-2))
    right = np.concatenate([wanted.real, wanted.imag], axis=-1)[..., None]
    weights = np.linalg.solve(r, np.swapaxes(q, -1, -2) @ right)[..., 0]
    weights = np.where(finite[..., None], weights, 0.0)
    return 1 - weights.sum(axis=-1), weights, 2 * np.pi * hz


def _poles(corner: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Corner frequencies (..., BRANCHES), Hz: log-spaced afar, closer together near the corner the nearer order is 1.

    The fractional lag is a continuum of poles, logistic in log frequency, that narrows to one pole at order 1. The
    constants are those with the smallest largest error.
    """
    width, high = 6.2 * (1 - order) ** 0.68, 4600.0
    low = 1 / (np.exp(-6.2 * order) / 0.0066 + 2 / corner)
    ends = np.arcsinh(np.log(np.stack([low, np.broadcast_to(high, low.shape)]) / corner) / width)
    along = ends[0, ..., None] + (ends[1] - ends[0])[..., None] * np.linspace(0, 1, BRANCHES)
    return corner[..., None] * np.exp(width[..., None] * np.sinh(along))


@lru_cache(64)
def _remembered(corner_hz: bytes, order: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The branches of arrays given by their bytes: the lanes of many recordings share their effect."""
    return eddy_branches(np.frombuffer(corner_hz), np.frombuffer(order))


def pulling_current(system: System, values: Values, current: np.ndarray) -> np.ndarray:
    """The branches: from the coil's current to the one that pulls, both signals in A."""
    corner, order = values.effect("eddy_current"), values.effect("eddy_current", "order")
    if system.without(STATES, there := np.isfinite(corner)):
        return current
    direct, weights, rates = _remembered(corner.tobytes(), order.tobytes())
    branches = system.signals(STATES)
    rates = (rates * system.step[:, None])[:, :, None] * (current[:, None] - branches)
    system.put_all(STATES, rates, there)
    return direct[:, None] * current + (weights[:, None] @ branches)[:, 0]


# Rows of a lane. EDDY: currents of the branches, A. EDDY_NODES: what each adds to the three nodal currents; EDDY_NEXT:
# each at the end of the step from x1, x2 and itself; EDDY_COMMANDS: from the old and the new command.
EDDY, EDDY_NODES, EDDY_NEXT, EDDY_COMMANDS, END = rows_after(
    amplifier.END,
    f"EDDY[{BRANCHES}] EDDY_NODES[{3 * BRANCHES}] EDDY_NEXT[{3 * BRANCHES}] EDDY_COMMANDS[{2 * BRANCHES}]",
)


@piece
def eddy_node(x, k, node):
    """What the branches add to the nodal current at row `node` (0, 1 or 2 times W)."""
    total = 0.0
    for j in range(BRANCHES):
        total = total + x[k + EDDY_NODES + node + 3 * j * W] * x[k + EDDY + j * W]
    return total


@piece
def store_eddy(x, k, old, new):
    """Take the branches to the end of the step, under the old and the new command."""
    x1, x2 = x[k + X1], x[k + X2]
    for j in range(BRANCHES):
        n, c = k + EDDY_NEXT + 3 * j * W, k + EDDY_COMMANDS + 2 * j * W
        branch = x[n] * x1 + x[n + W] * x2 + x[n + 2 * W] * x[k + EDDY + j * W]
        x[k + EDDY + j * W] = branch + x[c] * old + x[c + W] * new
    return 0.0
