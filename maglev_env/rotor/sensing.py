"""Self-sensors of a rotor's kernel: the coils that are read at both magnet planes, in x and in y, edge by edge."""

from collections.abc import Callable

from maglev_env.rotor.rows import COIL_GAP, CURRENT, MAGNETS, Q, QD, SELF, STEP, STRIDE
from maglev_lanes.layout import LANES as W
from maglev_lanes.pieces import piece
from selfsense import kernel_loop
from selfsense.kernel_pieces import SensorStructure
from selfsense.kernel_rows import HIGHEST, LOWEST

COILS = 4  # ordered as `linear.AXES`


@piece
def at_magnet(x, i, p, first):
    """Displacement (m) at coil p of lane i, or with the rates as `first` row its rate."""
    own = i + first + 2 * (p & 1) * W
    return x[own] + x[i + MAGNETS + (p >> 1) * W] * x[own + W]


@piece
def _gap(x, i, p, here):
    """The coil's gap, m; where a touchdown has pressed the rotor in, within the range that its estimator believes."""
    k = i + SELF + p * STRIDE
    y, v = at_magnet(x, i, p, Q), x[i + STEP] * at_magnet(x, i, p, QD)
    found = kernel_loop.moved_gap(x, k, x[i + COIL_GAP], 0.0, y, v, here)
    return min(max(found, x[k + LOWEST]), x[k + HIGHEST])


@piece
def _target(x, i, p, ahead):
    return kernel_loop.wanted_current(x, i + SELF + p * STRIDE, x[i + CURRENT + p * W], ahead)


@piece
def begin(x):
    """Store motion and currents at the start of a step of the integration."""
    for p in range(COILS):
        for i in range(W):
            y, v = at_magnet(x, i, p, Q), x[i + STEP] * at_magnet(x, i, p, QD)
            kernel_loop.begin_step(x, i + SELF + p * STRIDE, y, v, x[i + CURRENT + p * W])


def follow_piece(structure: SensorStructure) -> Callable:
    """follow(x, seeds, tick, timing): as `selfsense.kernel_loop.follow_piece`; the probes' seeds come first."""
    return kernel_loop.follow_piece(structure, COILS, (SELF, STRIDE, COILS * W), _gap, _target)


@piece
def read_coils(x, tile, o):
    """Write what the self-sensors read, and behind it the displacements that they read, into a sample at o."""
    for p in range(COILS):
        for i in range(W):
            tile[o + p * W + i] = kernel_loop.displacement(x, i + SELF + p * STRIDE)
            tile[o + (COILS + p) * W + i] = at_magnet(x, i, p, Q)
