"""The self-sensor's block in a kernel: what the coil sees of the rotor's motion and the amplifier, and its reading."""

from collections.abc import Callable

from maglev_env.loop.amplifier import OPEN, X1, X2
from maglev_env.loop.controller import ACTING, U
from maglev_env.loop.free import places as free
from maglev_env.loop.magnets.rows import GAP, OFFSET
from maglev_env.loop.mechanics import V, Y
from maglev_env.loop.sensor import Z1
from maglev_lanes.pieces import piece
from selfsense import kernel_loop
from selfsense import kernel_rows as rows

SELF = free.END  # where the self-sensor's rows begin
END = SELF + rows.END
REST_CURRENT, COIL_GAP, SHIFT = SELF + rows.REST_CURRENT, SELF + rows.GAP, SELF + rows.SHIFT
OFF_SUM, OFF_SQ, OFF_PEAK = SELF + rows.OFF_SUM, SELF + rows.OFF_SQ, SELF + rows.OFF_PEAK


def carried_current(poles: int, delayed: bool, flexible: bool) -> Callable:
    """A piece that gives the present control current (A) after the nominal amplifier.

    Args:
        poles: number of the amplifier's poles, 0 .. 2.
        delayed: whether a delay lies between the controller's command and the one that acts.
        flexible: whether the kernel is the flexible one.
    """
    acting = ACTING if delayed else U

    @piece
    def current(x, k):
        if flexible:
            return x[k + X2] + x[k + OPEN] * (x[k + acting] - x[k + X2])
        if poles == 2:
            return x[k + X2]
        return x[k + X1] if poles == 1 else x[k + acting]

    return current


def step_begun(current: Callable) -> Callable:
    """A piece that stores the motion and the current at the start of a step."""

    @piece
    def begin(x, k):
        return kernel_loop.begin_step(x, k + SELF, x[k + Y], x[k + V], current(x, k))

    return begin


def gap_of(axis: int) -> Callable:
    """A piece that gives the gap (m) of the p-th axis' coil at a fraction of the last step; axis: size of an axis."""

    @piece
    def gap(x, i, p, here):
        k = i + p * axis
        return kernel_loop.moved_gap(x, k + SELF, x[k + GAP], x[k + OFFSET], x[k + Y], x[k + V], here)

    return gap


def target_of(current: Callable, axis: int) -> Callable:
    """A piece that gives the wanted mean current (A) of the p-th axis' coil at a time `ahead`, in steps."""

    @piece
    def target(x, i, p, ahead):
        k = i + p * axis
        return kernel_loop.wanted_current(x, k + SELF, current(x, k), ahead)

    return target


@piece
def show(x, k):
    """Store the displacement that corresponds to the estimated gap in the row of the probe's state."""
    x[k + Z1] = kernel_loop.displacement(x, k + SELF)
    return 0.0


@piece
def note_error(x, k, off):
    """Accumulate sum, sum of squares and peak of the reading's error (m)."""
    kernel_loop.note_error(x, k + SELF, off)
    return 0.0
