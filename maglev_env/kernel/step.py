"""The step of the loop, once for one axis and for two: read, control, amplify, pull, move, touch down.

With two axes every number here is a pair (see `maglev_lanes.pair`). Each formula is a piece in its block's file.
"""

from collections.abc import Callable

from maglev_env.kernel.parts import parts
from maglev_env.kernel.structure import Structure
from maglev_lanes.layout import LANES as W
from maglev_lanes.pieces import piece

SIXTH = 1.0 / 6.0


def move_piece(s: Structure, lanes: int = W) -> Callable:
    """move(x, force_x, force_y): one integration step of as many lanes under held commands and forces (N).

    It uses Nystrom's method of 4th order. Both middle stages have the same position, so that three evaluations of the
    magnets are enough.
    """
    p = parts(s)
    flexible, sticking, probed, poles = s.flexible, s.sticking, s.sensed is None, s.sensor_poles
    pushed_by, position, velocity, bristles, deflect, friction = (
        p.pushed, p.position, p.velocity, p.bristles, p.deflect_bristles, p.friction,
    )  # fmt: skip
    current_start, current_middle, current_end = p.current_start, p.current_middle, p.current_end
    push_start, push_middle, push_end, damping = p.push_start, p.push_middle, p.push_end, p.damping
    force_start, force_middle, force_end = p.force_start, p.force_middle, p.force_end
    y_middle, v_middle, y_end, v_end, y_next, v_next = p.y_middle, p.v_middle, p.y_end, p.v_end, p.y_next, p.v_next
    x1_next, x2_next, held_next, z1_next, z2_next = p.x1_next, p.x2_next, p.held_next, p.z1_next, p.z2_next
    mount_next, mount_v_next, z1_by_mount, z2_by_mount = p.mount_next, p.mount_v_next, p.z1_by_mount, p.z2_by_mount
    shaped, felt_too, further_next, further_v_next = s.shaped, p.felt_too, p.further_next, p.further_v_next
    z1_by_further, z2_by_further, store_further_mode = p.z1_by_further, p.z2_by_further, p.store_further_mode
    store_reading, store_mount, store_current, store_body = (
        p.store_reading, p.store_mount, p.store_current, p.store_body,
    )  # fmt: skip
    store_state, store_bristles, turn_pointers = p.store_state, p.store_bristles, p.turn_pointers
    touch_down, distance_sq = p.touch_down, p.distance_sq

    # The loop over lanes stands in here, with its full body: around a mere call it would be unrolled before the call is
    # inlined, and never be vectorised.
    @piece
    def move(x, force_x, force_y):
        for k in range(lanes):
            y, v, outside = position(x, k), velocity(x, k), pushed_by(x, k, force_x, force_y)
            p0, pm, p1 = push_start(x, k, outside), push_middle(x, k, outside), push_end(x, k, outside)
            # Amplify.
            x1, x2 = x1_next(x, k), x2_next(x, k)
            held = held_next(x, k, x2)
            # Pull and move: accelerations by the bearing at the start, twice in the middle, and at the end.
            bent = bristles(x, k)
            a1 = force_start(x, k, y, current_start(x, k)) - friction(x, k, bent) - damping(x, k, v)
            ym = y_middle(x, k, y, v, a1 + p0)
            bent = deflect(x, k, bent, ym - y)
            pulled = force_middle(x, k, ym, current_middle(x, k, held)) - friction(x, k, bent)
            a2 = pulled - damping(x, k, v_middle(x, k, v, a1 + p0))
            a3 = pulled - damping(x, k, v_middle(x, k, v, a2 + pm))
            ye, ve = y_end(x, k, y, v, a3 + pm), v_end(x, k, v, a3 + pm)
            rubbed = friction(x, k, deflect(x, k, bent, ye - ym))
            a4 = force_end(x, k, ye, current_end(x, k, held)) - rubbed - damping(x, k, ve)
            am = 0.5 * (a2 + a3)
            b1, bm, b4 = a1 + p0, am + pm, a4 + p1
            y1, v1 = y_next(x, k, y, v, b1, bm, b4), v_next(x, k, v, b1, bm, b4)
            alive = touch_down(x, k, distance_sq(y1))
            # What the probe reads at the end of the step.
            if probed:
                z1, z2 = z1_next(x, k, y, v, y1, v1), z2_next(x, k, y, v, y1, v1)
                if flexible:
                    f1, fm, f4 = a1, am, a4  # what the mount feels of them
                    if shaped:
                        vm = v_middle(x, k, v, a2 + pm)
                        f1, fm = a1 + felt_too(x, k, y, v, p0), am + felt_too(x, k, ym, vm, pm)
                        f4 = a4 + felt_too(x, k, ye, ve, p1)
                    moved, pushed = SIXTH * (f1 + 2.0 * fm), SIXTH * (f1 + 4.0 * fm + f4)
                    z1 = z1 + z1_by_mount(x, k, moved, pushed)
                    z2 = z2 + z2_by_mount(x, k, moved, pushed)
                    if shaped:
                        z1, z2 = z1 + z1_by_further(x, k), z2 + z2_by_further(x, k)
                        other, other_v = further_next(x, k, moved, pushed), further_v_next(x, k, moved, pushed)
                        store_further_mode(x, k, other, other_v)
                    store_mount(x, k, mount_next(x, k, moved, pushed), mount_v_next(x, k, moved, pushed))
                if poles > 0:
                    store_reading(x, k, z1, z2)
            if flexible:
                store_body(x, k, b1, bm, b4)
                turn_pointers(x, k)
            if sticking:
                store_bristles(x, k, deflect(x, k, bent, y1 - ym))
            store_current(x, k, x1, x2, held)
            store_state(x, k, y1, v1, alive)

    return move
