"""Pieces of a flexible lane kernel for one axis: what the further effects do to one lane at one instant.

Every piece takes the block x and the lane i and works on scalars, in the units of `kernel_pieces`. A lane without an
effect carries constants that make naught of it.
"""

from collections.abc import Callable

import numpy as np
from numba.extending import register_jitable

from maglev_env.loop.eddy import BRANCHES
from maglev_env.kernel.effect_rows import (
    BEND,
    BENT,
    BODY,
    BODY_SHARE,
    BODY_V,
    BY_COMMAND_BEND,
    BY_COMMAND_CROSS,
    BY_COMMAND_NEXT,
    BY_COMMAND_NODES,
    BY_NODES,
    CROSS_BEND,
    EDDY,
    FRICTION,
    HELD,
    HOLD,
    KEPT,
    MAINS_C,
    MAINS_S,
    MAINS_TURN_C,
    MAINS_TURN_S,
    MOUNT,
    MOUNT_V,
    MOVER_SHARE,
    NEXT,
    NODES,
    OPEN,
    PER_BEND,
    PER_WIDTH,
    PICKUP,
    PROBE,
    REACH,
    RUNOUT,
    SHAFT_C,
    SHAFT_S,
    SLIP_SQ,
    TO_END,
    TO_MIDDLE,
    TURN_C,
    TURN_S,
    UNBALANCE,
)
from maglev_env.kernel.rows import (
    ACTING,
    ALIVE,
    ARRIVED,
    CHAIN_ROWS,
    LANES,
    LIMIT_SQ,
    PER_MASS,
    STEPS,
    U_OLD,
    V,
    X1,
    X2,
    Y,
    Z1,
    Z2,
)

W = LANES


def reading_pieces(effects: int) -> tuple[Callable, ...]:
    """tone and coil, of the axis that begins at b, whose effects' rows begin `effects` rows behind that."""
    e = effects * W

    @register_jitable(forceinline=True)
    def harmonics(x, first, c):
        """Three harmonics of amplitudes from `first` on, of an angle with cosine c."""
        square = c * c
        total = x[first] * c + x[first + W] * (2.0 * square - 1.0)
        return total + x[first + 2 * W] * (c * (4.0 * square - 3.0))

    @register_jitable(forceinline=True)
    def tone(x, b, i):
        """What runout and pickup add to the reading."""
        q = b + e + i
        return harmonics(x, q + RUNOUT * W, x[q + SHAFT_C * W]) + harmonics(x, q + PICKUP * W, x[q + MAINS_C * W])

    @register_jitable(forceinline=True)
    def coil(x, b, i, substep):
        """The coil's current as a substep begins; without a pole the command itself, as far as the voltage allows."""
        now, q = x[b + X2 * W + i], b + e + i
        arrived = x[b + (ARRIVED + substep * CHAIN_ROWS) * W + i]
        u = arrived * x[b + ACTING * W + i] + (1.0 - arrived) * x[b + U_OLD * W + i]
        kept, reach = x[q + KEPT * W] * x[b + X1 * W + i], x[q + REACH * W]
        return now + x[q + OPEN * W] * (min(max(u, kept - reach), kept + reach) - now)

    return tone, coil


def effect_pieces(effects: int, controlled: bool) -> tuple[Callable, ...]:
    """commands, drive, outside, whole_speed, halfway, ending, landed, probed, beside, keep, show, bristles, bend, rub
    and keep_bent of the axis whose rows begin at row 0 and its effects' at row `effects`; a lane of the second axis
    counts on from the first one's."""
    e = effects * W

    @register_jitable(forceinline=True)
    def commands(x, i):
        """The command that acted and the one that acts from now on, as far as the coil's voltage allows."""
        kept, reach = x[e + KEPT * W + i] * x[X1 * W + i], x[e + REACH * W + i]
        low, high = kept - reach, kept + reach
        return min(max(x[U_OLD * W + i], low), high), min(max(x[ACTING * W + i], low), high)

    @register_jitable(forceinline=True)
    def faded(q):
        """e^-q of q at least 0, to 1e-8: a series to the 16th power."""
        a = min(q, 64.0) * (1.0 / 16.0)
        s = 1.0 + a * (1.0 + a * (1.0 / 2.0 + a * (1.0 / 6.0 + a * (1.0 / 24.0 + a * (1.0 / 120.0 + a / 720.0)))))
        s = s * s
        s = s * s
        s = s * s
        return 1.0 / (s * s)

    @register_jitable(forceinline=True)
    def drive(x, i, old, new):
        """Three nodal currents that pull (see `lane_chains.nodal`), next x1 and x2, next state of the hysteresis."""
        if not controlled:
            return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        p, x1, x2 = e + i, x[X1 * W + i], x[X2 * W + i]
        f, g = p + NODES * W, p + BY_COMMAND_NODES * W
        c0 = x[f] * x1 + x[f + W] * x2 + x[g] * old + x[g + W] * new
        c1 = x[f + 2 * W] * x1 + x[f + 3 * W] * x2 + x[g + 2 * W] * old + x[g + 3 * W] * new
        c2 = x[f + 4 * W] * x1 + x[f + 5 * W] * x2 + x[g + 4 * W] * old + x[g + 5 * W] * new
        for k in range(BRANCHES):
            branch, h = x[p + (EDDY + k) * W], f + (6 + 3 * k) * W
            c0, c1, c2 = c0 + x[h] * branch, c1 + x[h + W] * branch, c2 + x[h + 2 * W] * branch
        f, g = p + NEXT * W, p + BY_COMMAND_NEXT * W
        n1 = x[f] * x1 + x[g] * old + x[g + W] * new
        n2 = x[f + W] * x1 + x[f + 2 * W] * x2 + x[g + 2 * W] * old + x[g + 3 * W] * new
        # Dahl's model between both ends of the coil's current.
        change, held = n2 - x2, x[p + HELD * W]
        toward = 1.0 if change > 0.0 else -1.0
        after = toward + (held - toward) * faded(abs(change) * x[p + PER_WIDTH * W])
        hold = x[p + HOLD * W]
        return c0 - hold * held, c1 - hold * (0.5 * (held + after)), c2 - hold * after, n1, n2, after

    @register_jitable(forceinline=True)
    def outside(x, i, force):
        """Acceleration from outside at the start, middle and end of the step: the held force and the unbalance."""
        p = e + i
        f, c, s, q = force * x[PER_MASS * W + i], x[p + SHAFT_C * W], x[p + SHAFT_S * W], p + UNBALANCE * W
        f0, fm = f + x[q] * c + x[q + W] * s, f + x[q + 2 * W] * c + x[q + 3 * W] * s
        return f0, fm, f + x[q + 4 * W] * c + x[q + 5 * W] * s

    # With a second body of `share` of the whole mass at r, y + share r moves as a free mass does, and r as an
    # oscillator that all other acceleration drives: both maps are exact for an acceleration of three nodes.
    @register_jitable(forceinline=True)
    def whole_speed(x, i, v):
        """Velocity of the centre of mass of the mover and the second body."""
        return v + x[e + BODY_SHARE * W + i] * x[e + BODY_V * W + i]

    @register_jitable(forceinline=True)
    def halfway(x, i, y, whole, a):
        """Position and velocity in the middle of the step under a constant acceleration."""
        p = e + i
        r, rv, share, mover = x[p + BODY * W], x[p + BODY_V * W], x[p + BODY_SHARE * W], x[p + MOVER_SHARE * W]
        q = p + TO_MIDDLE * W
        rm, rvm = x[q] * r + x[q + W] * rv + x[q + 2 * W] * a, x[q + 3 * W] * r + x[q + 4 * W] * rv + x[q + 5 * W] * a
        a = mover * a
        return y + 0.5 * whole + 0.125 * a - share * (rm - r), whole + 0.5 * a - share * rvm

    @register_jitable(forceinline=True)
    def ending(x, i, y, whole, a):
        """Position and velocity at the end of the step under a constant acceleration."""
        p = e + i
        r, rv, share, mover = x[p + BODY * W], x[p + BODY_V * W], x[p + BODY_SHARE * W], x[p + MOVER_SHARE * W]
        q, n = p + TO_END * W, p + BY_NODES * W
        re = x[q] * r + x[q + W] * rv + (x[n] + x[n + W] + x[n + 2 * W]) * a
        rve = x[q + 2 * W] * r + x[q + 3 * W] * rv + (x[n + 3 * W] + x[n + 4 * W] + x[n + 5 * W]) * a
        a = mover * a
        return y + whole + 0.5 * a - share * (re - r), whole + a - share * rve

    @register_jitable(forceinline=True)
    def landed(x, i, y, whole, a1, am, a4):
        """Position and velocity at the end of the step, then those of the second body."""
        p = e + i
        r, rv, share, mover = x[p + BODY * W], x[p + BODY_V * W], x[p + BODY_SHARE * W], x[p + MOVER_SHARE * W]
        q, n = p + TO_END * W, p + BY_NODES * W
        r1 = x[q] * r + x[q + W] * rv + x[n] * a1 + x[n + W] * am + x[n + 2 * W] * a4
        rv1 = x[q + 2 * W] * r + x[q + 3 * W] * rv + x[n + 3 * W] * a1 + x[n + 4 * W] * am + x[n + 5 * W] * a4
        y1 = y + whole + mover * ((a1 + 2.0 * am) * (1.0 / 6.0)) - share * (r1 - r)
        return y1, whole + mover * ((a1 + 4.0 * am + a4) * (1.0 / 6.0)) - share * rv1, r1, rv1

    @register_jitable(forceinline=True)
    def probed(x, i, old, new, y, v, y1, v1, moved, pushed):
        """Next mount and probe states: exact for the cubic through both ends of the motion, for a linear acceleration
        of the bearing that moved and pushed the mover so far in the step, and for what the current adds to both."""
        p = e + i
        x1, x2, m, mv = x[X1 * W + i], x[X2 * W + i], x[p + MOUNT * W], x[p + MOUNT_V * W]
        z1, z2 = x[Z1 * W + i], x[Z2 * W + i]
        q = p + PROBE * W
        m1 = x[q] * m + x[q + W] * mv + x[q + 2 * W] * moved + x[q + 3 * W] * pushed
        q = q + 4 * W
        mv1 = x[q] * m + x[q + W] * mv + x[q + 2 * W] * moved + x[q + 3 * W] * pushed
        q = q + 4 * W
        n1 = x[q] * z1 + x[q + W] * m + x[q + 2 * W] * mv + x[q + 3 * W] * moved + x[q + 4 * W] * pushed
        n1 = n1 + x[q + 5 * W] * y + x[q + 6 * W] * v + x[q + 7 * W] * y1 + x[q + 8 * W] * v1
        q = q + 9 * W
        n2 = x[q] * z1 + x[q + W] * z2 + x[q + 2 * W] * m + x[q + 3 * W] * mv + x[q + 4 * W] * moved
        n2 = n2 + x[q + 5 * W] * pushed
        n2 = n2 + x[q + 6 * W] * y + x[q + 7 * W] * v + x[q + 8 * W] * y1 + x[q + 9 * W] * v1
        if not controlled:
            return m1, mv1, n1, n2
        q, c = p + BEND * W, p + BY_COMMAND_BEND * W
        m1 = m1 + x[q] * x1 + x[q + W] * x2 + x[c] * old + x[c + W] * new
        mv1 = mv1 + x[q + 2 * W] * x1 + x[q + 3 * W] * x2 + x[c + 2 * W] * old + x[c + 3 * W] * new
        n1 = n1 + x[q + 4 * W] * x1 + x[q + 5 * W] * x2 + x[c + 4 * W] * old + x[c + 5 * W] * new
        n2 = n2 + x[q + 6 * W] * x1 + x[q + 7 * W] * x2 + x[c + 6 * W] * old + x[c + 7 * W] * new
        return m1, mv1, n1, n2

    @register_jitable(forceinline=True)
    def beside(x, i, other, old, new):
        """What the other axis' current, under its commands, adds to the next mount and probe states."""
        q, c, x1, x2 = e + CROSS_BEND * W + i, e + BY_COMMAND_CROSS * W + i, x[X1 * W + other], x[X2 * W + other]
        m1 = x[q] * x1 + x[q + W] * x2 + x[c] * old + x[c + W] * new
        mv1 = x[q + 2 * W] * x1 + x[q + 3 * W] * x2 + x[c + 2 * W] * old + x[c + 3 * W] * new
        n1 = x[q + 4 * W] * x1 + x[q + 5 * W] * x2 + x[c + 4 * W] * old + x[c + 5 * W] * new
        return m1, mv1, n1, x[q + 6 * W] * x1 + x[q + 7 * W] * x2 + x[c + 6 * W] * old + x[c + 7 * W] * new

    @register_jitable(forceinline=True)
    def keep(x, i, alive, old, new, n1, n2, held, y1, v1, r1, rv1):
        """Write what the step led to, but for the probe; a lane that has touched down stays where it was."""
        p = e + i
        if controlled:
            x1, x2 = x[X1 * W + i], x[X2 * W + i]
            for k in range(BRANCHES):
                f, g = p + (NEXT + 3 + 3 * k) * W, p + (BY_COMMAND_NEXT + 4 + 2 * k) * W
                branch = x[f] * x1 + x[f + W] * x2 + x[f + 2 * W] * x[p + (EDDY + k) * W]
                x[p + (EDDY + k) * W] = branch + x[g] * old + x[g + W] * new
            x[X1 * W + i], x[X2 * W + i], x[p + HELD * W] = n1, n2, held
        c, s, tc, ts = x[p + SHAFT_C * W], x[p + SHAFT_S * W], x[p + TURN_C * W], x[p + TURN_S * W]
        x[p + SHAFT_C * W], x[p + SHAFT_S * W] = c * tc - s * ts, s * tc + c * ts
        c, s, tc, ts = x[p + MAINS_C * W], x[p + MAINS_S * W], x[p + MAINS_TURN_C * W], x[p + MAINS_TURN_S * W]
        x[p + MAINS_C * W], x[p + MAINS_S * W] = c * tc - s * ts, s * tc + c * ts
        x[p + BODY * W], x[p + BODY_V * W] = r1, rv1
        x[Y * W + i] = y1 if alive > 0.0 else x[Y * W + i]
        x[V * W + i] = v1 * alive

    @register_jitable(forceinline=True)
    def show(x, i, m1, mv1, z1, z2):
        """Write the next mount and probe states."""
        x[e + MOUNT * W + i], x[e + MOUNT_V * W + i] = m1, mv1
        x[Z1 * W + i], x[Z2 * W + i] = z1, z2

    # Friction that sticks: its force follows the way of the mover, not its velocity.
    @register_jitable(forceinline=True)
    def bristles(x, i):
        """How far the bristles are bent as the step begins, -1 .. 1."""
        return x[e + BENT * W + i]

    @register_jitable(forceinline=True)
    def bend(x, i, bent, moved):
        """How far they are after half a step that moved the mover so far: exact at constant velocity, and without slip
        (Dahl) for any motion that does not turn back. Never beyond 1, however stiff they are."""
        path = np.sqrt(moved * moved + 0.25 * x[e + SLIP_SQ * W + i])
        toward = moved / path
        return toward + (bent - toward) * faded(path * x[e + PER_BEND * W + i])

    @register_jitable(forceinline=True)
    def rub(x, i, bent):
        """Deceleration by bristles bent so far."""
        return x[e + FRICTION * W + i] * bent

    @register_jitable(forceinline=True)
    def keep_bent(x, i, bent):
        x[e + BENT * W + i] = bent

    moving = commands, drive, outside, whole_speed, halfway, ending, landed
    return *moving, probed, beside, keep, show, bristles, bend, rub, keep_bent


def move_piece(
    pieces: tuple[Callable, ...],
    mechanics: tuple[Callable, ...],
    size: int,
    planar: bool,
    coupled: bool,
    sensing: bool,
    sticking: bool,
) -> Callable:
    """move(x, force, force_2): one step of all lanes from `effect_pieces` and mechanics (pull, drag, push, sway); the
    second axis' lane lies `size` entries behind the first one's."""
    commands, drive, outside, whole_speed, halfway, ending, landed, *rest = pieces
    probed, beside, keep, show, bristles, bend, rub, keep_bent = rest
    pull, drag, push, sway = mechanics
    sixth = 1.0 / 6.0

    # The loop is in here: one around a mere call is unrolled before the call is inlined, and then never vectorised.
    @register_jitable(forceinline=True)
    def move(x, force, force_2):
        for i in range(W):
            k = size + i
            y, v = x[Y * W + i], x[V * W + i]
            old, new = commands(x, i)
            c0, c1, c2, n1, n2, held = drive(x, i, old, new)
            f0, fm, fe = outside(x, i, force)
            whole = whole_speed(x, i, v)
            # a: accelerations by the bearing alone, at the start, twice in the middle, and at the end.
            a1 = pull(x, i, y, c0) - drag(x, i, v)
            if planar:
                y_2, v_2 = x[Y * W + k], x[V * W + k]
                old_2, new_2 = commands(x, k)
                c0_2, c1_2, c2_2, n1_2, n2_2, held_2 = drive(x, k, old_2, new_2)
                f0_2, fm_2, fe_2 = outside(x, k, force_2)
                whole_2 = whole_speed(x, k, v_2)
                a1_2 = pull(x, k, y_2, c0_2) - drag(x, k, v_2)
            if sticking:
                bent = bristles(x, i)
                a1 = a1 - rub(x, i, bent)
                if planar:
                    bent_2 = bristles(x, k)
                    a1_2 = a1_2 - rub(x, k, bent_2)
            if coupled:
                a1 = a1 + push(x, i, y_2, c0_2) - sway(x, i, v_2)
                a1_2 = a1_2 + push(x, k, y, c0) - sway(x, k, v)
            ym, vm = halfway(x, i, y, whole, a1 + f0)
            pulled = pull(x, i, ym, c1)
            if planar:
                ym_2, vm_2 = halfway(x, k, y_2, whole_2, a1_2 + f0_2)
                pulled_2 = pull(x, k, ym_2, c1_2)
            if sticking:
                bent = bend(x, i, bent, ym - y)
                pulled = pulled - rub(x, i, bent)
                if planar:
                    bent_2 = bend(x, k, bent_2, ym_2 - y_2)
                    pulled_2 = pulled_2 - rub(x, k, bent_2)
            if coupled:
                pulled = pulled + push(x, i, ym_2, c1_2)
                pulled_2 = pulled_2 + push(x, k, ym, c1)
            a2 = pulled - drag(x, i, vm)
            if planar:
                a2_2 = pulled_2 - drag(x, k, vm_2)
            if coupled:
                a2 = a2 - sway(x, i, vm_2)
                a2_2 = a2_2 - sway(x, k, vm)
            _, vm = halfway(x, i, y, whole, a2 + fm)
            a3 = pulled - drag(x, i, vm)
            if planar:
                _, vm_2 = halfway(x, k, y_2, whole_2, a2_2 + fm_2)
                a3_2 = pulled_2 - drag(x, k, vm_2)
            if coupled:
                a3 = a3 - sway(x, i, vm_2)
                a3_2 = a3_2 - sway(x, k, vm)
            ye, ve = ending(x, i, y, whole, a3 + fm)
            a4 = pull(x, i, ye, c2) - drag(x, i, ve)
            if planar:
                ye_2, ve_2 = ending(x, k, y_2, whole_2, a3_2 + fm_2)
                a4_2 = pull(x, k, ye_2, c2_2) - drag(x, k, ve_2)
            if sticking:
                a4 = a4 - rub(x, i, bend(x, i, bent, ye - ym))
                if planar:
                    a4_2 = a4_2 - rub(x, k, bend(x, k, bent_2, ye_2 - ym_2))
            if coupled:
                a4 = a4 + push(x, i, ye_2, c2_2) - sway(x, i, ve_2)
                a4_2 = a4_2 + push(x, k, ye, c2) - sway(x, k, ve)
            am = 0.5 * (a2 + a3)
            y1, v1, r1, rv1 = landed(x, i, y, whole, a1 + f0, am + fm, a4 + fe)
            reach = y1 * y1
            if planar:
                am_2 = 0.5 * (a2_2 + a3_2)
                y1_2, v1_2, r1_2, rv1_2 = landed(x, k, y_2, whole_2, a1_2 + f0_2, am_2 + fm_2, a4_2 + fe_2)
                reach = reach + y1_2 * y1_2
            alive = x[ALIVE * W + i] if reach < x[LIMIT_SQ * W + i] else 0.0
            x[ALIVE * W + i] = alive
            x[STEPS * W + i] += alive
            if not sensing:
                moved, pushed = (a1 + 2.0 * am) * sixth, (a1 + 4.0 * am + a4) * sixth
                m1, mv1, z1, z2 = probed(x, i, old, new, y, v, y1, v1, moved, pushed)
                if planar:
                    moved_2, pushed_2 = (a1_2 + 2.0 * am_2) * sixth, (a1_2 + 4.0 * am_2 + a4_2) * sixth
                    m1_2, mv1_2, z1_2, z2_2 = probed(x, k, old_2, new_2, y_2, v_2, y1_2, v1_2, moved_2, pushed_2)
                if coupled:
                    b1, b2, b3, b4 = beside(x, i, k, old_2, new_2)
                    m1, mv1, z1, z2 = m1 + b1, mv1 + b2, z1 + b3, z2 + b4
                    b1, b2, b3, b4 = beside(x, k, i, old, new)
                    m1_2, mv1_2, z1_2, z2_2 = m1_2 + b1, mv1_2 + b2, z1_2 + b3, z2_2 + b4
                show(x, i, m1, mv1, z1, z2)
                if planar:
                    show(x, k, m1_2, mv1_2, z1_2, z2_2)
            if sticking:
                keep_bent(x, i, bend(x, i, bent, y1 - ym))
                if planar:
                    keep_bent(x, k, bend(x, k, bent_2, y1_2 - ym_2))
            keep(x, i, alive, old, new, n1, n2, held, y1, v1, r1, rv1)
            if planar:
                keep(x, k, alive, old_2, new_2, n1_2, n2_2, held_2, y1_2, v1_2, r1_2, rv1_2)

    return move
