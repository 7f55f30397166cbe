"""The self-sensor's block in a kernel: how the rotor's motion and the amplifier reach the coil, and its reading."""

from collections.abc import Callable

from maglev_env.loop import external
from maglev_env.loop.amplifier import OPEN, X1, X2
from maglev_env.loop.controller import ACTING, U
from maglev_env.loop.magnets.rows import GAP, OFFSET
from maglev_env.loop.mechanics import V, Y
from maglev_env.loop.sensor import Z1
from maglev_lanes.pieces import piece
from selfsense import kernel_rows as rows

SELF = external.END  # where the self-sensor's rows begin
END = SELF + rows.END
BEGUN_Y, BEGUN_V, BEGUN_CURRENT = SELF + rows.BEGUN_Y, SELF + rows.BEGUN_V, SELF + rows.BEGUN_CURRENT
REST_CURRENT, REST_GAP, COIL_GAP = SELF + rows.REST_CURRENT, SELF + rows.REST_GAP, SELF + rows.GAP
SCALE, SHIFT, ESTIMATE = SELF + rows.SCALE, SELF + rows.SHIFT, SELF + rows.ESTIMATE
OFF_SUM, OFF_SQ, OFF_PEAK = SELF + rows.OFF_SUM, SELF + rows.OFF_SQ, SELF + rows.OFF_PEAK


def carried_current(poles: int, delayed: bool, flexible: bool) -> Callable:
    """A piece: the control current now, as the nominal amplifier carries it."""
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
    """A piece: remember with what a step begins."""

    @piece
    def begin(x, k):
        x[k + BEGUN_Y], x[k + BEGUN_V], x[k + BEGUN_CURRENT] = x[k + Y], x[k + V], current(x, k)
        return 0.0

    return begin


@piece
def gap(x, k, here):
    """The coil's gap at a fraction of the step just made: the cubic through both ends of the motion."""
    rest = 1.0 - here
    ends = x[k + BEGUN_Y] * (rest * rest * (1.0 + 2.0 * here)) + x[k + Y] * (here * here * (3.0 - 2.0 * here))
    bend = x[k + BEGUN_V] * rest - x[k + V] * here
    return x[k + GAP] - (ends + x[k + OFFSET]) - bend * (here * rest)


def wanted_current(current: Callable) -> Callable:
    """A piece: the coil's mean current wanted at a time in steps from the beginning of the step, its change carried
    on."""

    @piece
    def target(x, k, ahead):
        begun = x[k + BEGUN_CURRENT]
        return x[k + REST_CURRENT] + begun + (current(x, k) - begun) * ahead

    return target


@piece
def show(x, k):
    """Write the displacement that the estimated gap stands for where the probe's state would be."""
    x[k + Z1] = x[k + SCALE] * (x[k + REST_GAP] - x[k + ESTIMATE]) + x[k + SHIFT]
    return 0.0


@piece
def note_error(x, k, off):
    """Gather by how much the reading is off, m."""
    x[k + OFF_SUM] += off
    x[k + OFF_SQ] += off * off
    x[k + OFF_PEAK] = max(x[k + OFF_PEAK], abs(off))
