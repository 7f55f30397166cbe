"""The pieces of the loop's blocks for one step, selected for a structure and lifted to its axes."""

from collections.abc import Callable
from types import SimpleNamespace

from maglev_env.kernel.layout import AXIS, PUSHED
from maglev_env.kernel.sample import own_or_shared
from maglev_env.kernel.structure import Structure
from maglev_env.loop import actuator, amplifier, eddy, external, further_body, mechanics, second_body, sensor
from maglev_env.loop.free import places as free
from maglev_env.loop.further import springs, uneven_gain, vibration
from maglev_env.loop.magnets.kinds import KINDS
from maglev_env.loop.magnets.rows import OFFSET
from maglev_lanes.layout import LANES as W
from maglev_lanes.pair import Lifts
from maglev_lanes.pieces import piece


def parts(s: Structure) -> SimpleNamespace:
    """All pieces of a step, for both axes at once (see `maglev_lanes.pair`)."""
    lift = Lifts(s.axes, AXIS)
    return SimpleNamespace(
        **_motion(s, lift), **_forces(s, lift), **_currents(s, lift), **_probe(s, lift), pushed=_pushed(s, lift)
    )


def _pushed(s: Structure, lift: Lifts) -> Callable:
    """A piece pushed(x, k, force_x, force_y): the held forces on a lane, its own ones or those that all lanes share."""
    own, both = lift.each(own_or_shared(s, PUSHED), 1), lift.both()
    return piece(lambda x, k, force_x, force_y: own(x, k, both(force_x, force_y)))


def _motion(s: Structure, lift: Lifts) -> dict[str, Callable]:
    bodies = further_body if s.shaped else second_body
    mover = bodies if s.flexible else mechanics
    found = {
        name: lift.each(getattr(mover, name), numbers)
        for name, numbers in (
            ("y_middle", 3), ("v_middle", 2), ("y_end", 3), ("v_end", 2), ("y_next", 5), ("v_next", 4),
        )
    }  # fmt: skip
    return found | {
        "position": lift.each(mechanics.position, 0),
        "velocity": lift.each(mechanics.velocity, 0),
        "distance_sq": lift.distance_sq(),
        "touch_down": mechanics.touch_down,
        "store_state": lift.each(mechanics.store_state, 3),
        "store_body": lift.each(bodies.store_body, 3),
    }


def _forces(s: Structure, lift: Lifts) -> dict[str, Callable]:
    """Pieces for the accelerations by the bearing and from outside, and for friction that sticks."""
    coupled, sticking, supported = s.coupled, s.sticking, s.supported
    sliding_too, flexible, controlled = s.flexible and not s.sticking, s.flexible, s.magnets != "none"
    further, freely = s.further, s.free
    kind = KINDS.get(s.magnets)
    shaped = s.saturating or s.steeper
    pull = kind and (kind.shaped_pull(s.saturating, s.steeper, s.shaped) if shaped and kind.shaped_pull else kind.pull)

    saturated = actuator.saturated_current if kind and kind.pair else actuator.saturated_current_near
    saturated = saturated if s.shaped else piece(lambda x, k, y, current: current)
    pushed_back = springs.pushed_back_shaped if s.shaped else springs.pushed_back
    unevenly = uneven_gain.pulling_shaped if s.shaped else uneven_gain.pulling

    def force_at(node: int) -> Callable:
        pulling_freely, pushed_freely = free.pulling(node), free.pushed_back(node)

        @piece
        def bearing(x, k, y, current):
            total = 0.0
            if controlled:
                moved = y + x[k + OFFSET] if flexible else y
                pulling = saturated(x, k, moved, current)
                pulling = unevenly(x, k, pulling) if further else pulling
                if freely:
                    pulling = pulling_freely(x, k, y, pulling)
                total = pull(x, k, moved, pulling)
            if further:
                total = total - pushed_back(x, k, y)
            if freely:
                total = total - pushed_freely(x, k, y)
            return total - mechanics.spring(x, k, y) if supported else total

        own = lift.each(bearing, 2)
        if not coupled:
            return own
        cross = lift.crossed(mechanics.cross_force, 2)
        return piece(lambda x, k, y, current: own(x, k, y, current) + cross(x, k, y, current))

    @piece
    def support(x, k, v):
        total = mechanics.damping(x, k, v) if supported else 0.0
        if freely:
            total = total + free.damped(x, k, v)
        return total + mechanics.sliding(x, k, v) if sliding_too else total

    own_damping = damping = lift.each(support, 1)
    if coupled:
        cross_damping = lift.crossed(mechanics.cross_damping, 1)

        @piece
        def damping(x, k, v):
            return own_damping(x, k, v) + cross_damping(x, k, v)

    deflect = mechanics.deflect_bristles_shaped if s.shaped else mechanics.deflect_bristles
    outside = [_outside(s, node) for node in range(3)]
    found = {name: lift.each(f, 1) for name, f in zip(("push_start", "push_middle", "push_end"), outside, strict=True)}
    found |= {
        "bristles": lift.each(mechanics.bristles if sticking else piece(lambda x, k: 0.0), 0),
        "deflect_bristles": lift.each(deflect if sticking else piece(lambda x, k, bent, moved: 0.0), 2),
        "friction": lift.each(mechanics.friction if sticking else piece(lambda x, k, bent: 0.0), 1),
        "store_bristles": lift.each(mechanics.store_bristles, 1),
    }
    forces = [force_at(node) for node in range(3)] if s.free else [force_at(0)] * 3
    found |= zip(("force_start", "force_middle", "force_end"), forces, strict=True)
    return found | {"damping": damping}


def _outside(s: Structure, node: int) -> Callable:
    """A piece for the acceleration by forces from outside at node 0, 1 or 2 of a step."""
    if not s.flexible:
        return mechanics.held_force
    outside, shaken = external.outside(node), vibration.shaken(node)
    return piece(lambda x, k, force: outside(x, k, force) + shaken(x, k)) if s.further else outside


def _currents(s: Structure, lift: Lifts) -> dict[str, Callable]:
    """Pieces for the nodal currents behind eddy currents and hysteresis, and for the states at the end of the step."""
    controlled, flexible = s.magnets != "none", s.flexible
    carried = amplifier.carried(s.actuator_poles, s.delayed, flexible, s.shaped)
    old, new = amplifier.commands(s.delayed, flexible, s.shaped)
    nodes = [carried(amplifier.NODES + 4 * node * W) for node in range(3)]
    start_of, middle_of, end_of = nodes
    next_held = actuator.held_next_shaped if s.shaped else actuator.held_next
    x1_of, x2_of = carried(amplifier.NEXT), carried(amplifier.NEXT + 4 * W)

    @piece
    def start(x, k):
        if not controlled:
            return 0.0
        now = start_of(x, k, k)
        return now + eddy.eddy_node(x, k, 0) - actuator.hold(x, k) if flexible else now

    @piece
    def middle(x, k, held):
        if not controlled:
            return 0.0
        now = middle_of(x, k, k)
        if not flexible:
            return now
        held_back = 0.5 * (actuator.hold(x, k) + actuator.hold_at(x, k, held))
        return now + eddy.eddy_node(x, k, W) - held_back

    @piece
    def end(x, k, held):
        if not controlled:
            return 0.0
        now = end_of(x, k, k)
        return now + eddy.eddy_node(x, k, 2 * W) - actuator.hold_at(x, k, held) if flexible else now

    @piece
    def x1_next(x, k):
        return x1_of(x, k, k) if controlled else 0.0

    @piece
    def x2_next(x, k):
        return x2_of(x, k, k) if controlled else 0.0

    @piece
    def held_next(x, k, x2):
        return next_held(x, k, x2) if flexible and controlled else 0.0

    store_current = amplifier.store_current(s.actuator_poles)

    @piece
    def store(x, k, x1, x2, held):
        if controlled:
            if flexible:
                eddy.store_eddy(x, k, old(x, k), new(x, k))
                actuator.store_held(x, k, held)
            store_current(x, k, x1, x2)
        return 0.0

    return {
        "current_start": lift.each(start, 0),
        "current_middle": lift.each(middle, 1),
        "current_end": lift.each(end, 1),
        "x1_next": lift.each(x1_next, 0),
        "x2_next": lift.each(x2_next, 0),
        "held_next": lift.each(held_next, 1),
        "store_current": lift.each(store, 3),
    }


def _probe(s: Structure, lift: Lifts) -> dict[str, Callable]:
    """Pieces for the states of the probe and its mount at the end of the step."""
    coupled, controlled = s.coupled, s.magnets != "none"
    carried = amplifier.carried(s.actuator_poles, s.delayed, s.flexible, s.shaped)

    def bent(own: Callable, numbers: int, first: int, other: int) -> Callable:
        """A state by the motion, corrected for the currents of this axis and of the other one."""
        by_own = carried(first)
        if controlled and numbers == 4:
            whole = lift.each(piece(lambda x, k, y, v, y1, v1: own(x, k, y, v, y1, v1) + by_own(x, k, k)), 4)
        elif controlled:
            whole = lift.each(piece(lambda x, k, moved, pushed: own(x, k, moved, pushed) + by_own(x, k, k)), 2)
        else:
            return lift.each(own, numbers)
        if not coupled:
            return whole
        by_other = lift.across(carried(other))
        if numbers == 4:
            return piece(lambda x, k, y, v, y1, v1: whole(x, k, y, v, y1, v1) + by_other(x, k))
        return piece(lambda x, k, moved, pushed: whole(x, k, moved, pushed) + by_other(x, k))

    supported = s.supported

    @piece
    def felt_too(x, k, y, v, outside):
        slowed = mechanics.spring(x, k, y) + mechanics.damping(x, k, v) if supported else 0.0
        return sensor.felt_too(x, k, slowed, outside)

    row = 4 * W
    return {
        "z1_next": bent(sensor.z1_next, 4, sensor.BEND, sensor.CROSS_BEND),
        "z2_next": bent(sensor.z2_next, 4, sensor.BEND + row, sensor.CROSS_BEND + row),
        "mount_next": bent(sensor.by_mount(sensor.MOUNT_NEXT), 2, sensor.MOUNT_BEND, sensor.MOUNT_CROSS),
        "mount_v_next": bent(
            sensor.by_mount(sensor.MOUNT_NEXT + row), 2, sensor.MOUNT_BEND + row, sensor.MOUNT_CROSS + row
        ),
        "z1_by_mount": lift.each(sensor.by_mount(sensor.MOUNT_SEEN), 2),
        "z2_by_mount": lift.each(sensor.by_mount(sensor.MOUNT_SEEN + row), 2),
        "further_next": bent(
            sensor.by_mount(sensor.FURTHER_NEXT, sensor.FURTHER_Y), 2, sensor.FURTHER_BEND, sensor.FURTHER_CROSS
        ),
        "further_v_next": bent(
            sensor.by_mount(sensor.FURTHER_NEXT + row, sensor.FURTHER_Y),
            2,
            sensor.FURTHER_BEND + row,
            sensor.FURTHER_CROSS + row,
        ),
        "z1_by_further": lift.each(sensor.seen_of_further_mode(sensor.FURTHER_SEEN), 0),
        "z2_by_further": lift.each(sensor.seen_of_further_mode(sensor.FURTHER_SEEN + 2 * W), 0),
        "store_further_mode": lift.each(sensor.store_mount(sensor.FURTHER_Y), 2),
        "felt_too": lift.each(felt_too, 3),
        "store_reading": lift.each(sensor.store_reading(s.sensor_poles), 2),
        "store_mount": lift.each(sensor.store_mount(), 2),
        "turn_pointers": lift.each(_turn_all if s.further else sensor.turn_pointers, 0),
    }


@piece
def _turn_all(x, k):
    """Turn the pointers of all tones to the end of the step."""
    return sensor.turn_pointers(x, k) + uneven_gain.turn_wave(x, k) + vibration.turn_shake(x, k)
