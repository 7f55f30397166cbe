"""Rows of the further effects of one axis in a flexible kernel's block, counted from the first of them."""

from maglev_env.loop.eddy import BRANCHES

# State: currents of the eddy branches, Dahl's hysteresis, the probe's mount, the second body, two turning pointers
# (cosine and sine), of the shaft with the runout's phase and of the mains with the pickup's, and how far the bristles
# of a friction that sticks are bent, as a share of the way at which they slide.
EDDY = 0
HELD, MOUNT, MOUNT_V, BODY, BODY_V, SHAFT_C, SHAFT_S, MAINS_C, MAINS_S, BENT = range(BRANCHES, BRANCHES + 10)
_FIRST = BRANCHES + 10
# Constants. OPEN: 1 where no pole follows the command; REACH, KEPT: the command that the voltage allows is
# KEPT x1 +- REACH; force by the held current; where the magnets' centre lies; Coulomb friction, its slip squared and
# what bends its bristles per m.
OPEN, REACH, KEPT, HOLD, PER_WIDTH, OFFSET, FRICTION, SLIP_SQ, PER_BEND = range(_FIRST, _FIRST + 9)
# Turn of the pointers in a substep, amplitudes of their three harmonics, and the unbalance's force at its start,
# middle and end, of the shaft's cosine and sine.
TURN_C, TURN_S, MAINS_TURN_C, MAINS_TURN_S, RUNOUT, PICKUP, UNBALANCE = (
    _FIRST + n for n in (9, 10, 11, 12, 13, 16, 19)
)
# The second body: its share of the whole mass, the mover's; then maps of (body, body_v, acceleration) to the middle,
# to the end, and what the three nodal accelerations add at the end.
BODY_SHARE, MOVER_SHARE, TO_MIDDLE, TO_END, BY_NODES = (_FIRST + n for n in (25, 26, 27, 33, 37))
# Exact chains. PROBE: next mount (4 each), z1 (9) and z2 (10) from states and the motion; BEND: what x1 and x2 add to
# these four over the smooth motion, CROSS_BEND: those of the other axis; NODES: three nodal currents from x1 x2 and the
# branches; NEXT: x1 from x1, x2 from x1 x2, every branch from x1 x2 and itself.
PROBE = _FIRST + 43
BEND = PROBE + 27
CROSS_BEND = BEND + 8
NODES = CROSS_BEND + 8
NEXT = NODES + 3 * (2 + BRANCHES)
# The same of the old and the new command, once per substep: nodes, next states, bend and bend by the other axis.
COMMAND = NEXT + 3 + 3 * BRANCHES
COMMAND_ROWS = 2 * (3 + 2 + BRANCHES + 4 + 4)
BY_COMMAND_NODES, BY_COMMAND_NEXT = COMMAND, COMMAND + 6
BY_COMMAND_BEND = BY_COMMAND_NEXT + 2 * (2 + BRANCHES)
BY_COMMAND_CROSS = BY_COMMAND_BEND + 8


def command_row(substep: int) -> int:
    """Where a substep's rows of the commands are kept; those of the current one lie at COMMAND."""
    return COMMAND + (1 + substep) * COMMAND_ROWS


def effect_rows(substeps: int) -> int:
    """Rows of the effects of one axis; with a single substep its rows of the commands are there once."""
    return command_row(substeps if substeps > 1 else 0)
