"""The self-sensor's block in a kernel: what the coil sees of the rotor's motion and the amplifier, and its reading."""

from collections.abc import Callable

from maglev_env.loop.amplifier import OPEN, X1, X2
from maglev_env.loop.controller import ACTING, U
from maglev_env.loop.free import places as free
from maglev_env.loop.magnets.rows import GAP, OFFSET
from maglev_env.loop.mechanics import V, Y
from maglev_env.loop.sensor import Z1
from maglev_lanes.pieces import piece
from selfsense import kernel_rows as rows

SELF = free.END  # where the self-sensor's rows begin
END = SELF + rows.END
BEGUN_Y, BEGUN_V, BEGUN_CURRENT = SELF + rows.BEGUN_Y, SELF + rows.BEGUN_V, SELF + rows.BEGUN_CURRENT
REST_CURRENT, REST_GAP, COIL_GAP = SELF + rows.REST_CURRENT, SELF + rows.REST_GAP, SELF + rows.GAP
SCALE, SHIFT, ESTIMATE = SELF + rows.SCALE, SELF + rows.SHIFT, SELF + rows.ESTIMATE
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
        x[k + BEGUN_Y], x[k + BEGUN_V], x[k + BEGUN_CURRENT] = x[k + Y], x[k + V], current(x, k)
        return 0.0

    return begin


@piece
def gap(x, k, here):
    """The coil's gap (m) at a fraction of the last step, by the cubic through the motion at both its ends."""
    rest = 1.0 - here
    ends = x[k + BEGUN_Y] * (rest * rest * (1.0 + 2.0 * here)) + x[k + Y] * (here * here * (3.0 - 2.0 * here))
    bend = x[k + BEGUN_V] * rest - x[k + V] * here
    return x[k + GAP] - (ends + x[k + OFFSET]) - bend * (here * rest)


def wanted_current(current: Callable) -> Callable:
    """A piece that gives the wanted mean coil current (A) at a time `ahead`, in steps from the start of the step.

    The change of the current within the step is extrapolated linearly.
    """

    @piece
    def target(x, k, ahead):
        begun = x[k + BEGUN_CURRENT]
        return x[k + REST_CURRENT] + begun + (current(x, k) - begun) * ahead

    return target


@piece
def show(x, k):
    """Store the displacement that corresponds to the estimated gap in the row of the probe's state."""
    x[k + Z1] = x[k + SCALE] * (x[k + REST_GAP] - x[k + ESTIMATE]) + x[k + SHIFT]
    return 0.0


@piece
def note_error(x, k, off):
    """Accumulate sum, sum of squares and peak of the reading's error (m)."""
    x[k + OFF_SUM] += off
    x[k + OFF_SQ] += off * off
    x[k + OFF_PEAK] = max(x[k + OFF_PEAK], abs(off))
