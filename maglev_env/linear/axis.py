"""One axis of the linearised rig in continuous time: the blocks of the loop, one after the other."""

from dataclasses import dataclass

import numpy as np

from maglev_env.experiment import Experiment, self_sensors
from maglev_env.lane_values import lane_values
from maglev_env.loop import actuator, amplifier, mechanics, saturation, self_sensor, sensor
from maglev_env.loop.effect import effect_value
from maglev_env.loop.free import places as free
from maglev_env.loop.system import System

POSITION, VELOCITY = 0, 1  # indices of the first two states; the last two are the held force and the held command
_SECOND = np.ones(1)  # the unit of time


@dataclass(frozen=True)
class LinearAxis:
    """Linear equations of one axis; its n states include the held force (N) and the held command (A), which come last.

    Args:
        rates: (n, n), derivatives of the states per second, without the coupling to another axis.
        current: (n,), signal of the coil's current, A.
        pulling: (n,), signal of the force-producing current, A.
        reading: (n,), signal of the displacement read, m, before sensor_gain.
        driven: (n,), change of each derivative per unit of acceleration by the bearing.
    """

    rates: np.ndarray
    current: np.ndarray
    pulling: np.ndarray
    reading: np.ndarray
    driven: np.ndarray


def linear_axis(e: Experiment) -> LinearAxis:
    """The linear equations of a one-axis experiment: position, velocity, then the states of each block.

    Free corrections count as linearised over their range. Voltage limit, runout, pickup and unbalance have no linear
    part. The reaction to the bearing's force (magnets, support, friction and the coupling to another axis) moves the
    probe's mount; the held force and the second body do not, unless the form of its resonance says otherwise.
    """
    values, sensors = lane_values([e]), self_sensors(e)
    reading_states = self_sensor.STATES if sensors else sensor.STATES
    states = (*mechanics.MOTION, *amplifier.STATES, *actuator.STATES, *mechanics.STATES, *reading_states)
    freely = not free.NAMES.isdisjoint(e.effects)
    states += tuple(state for own in free.STATES.values() for state in own) if freely else ()
    # The bearing's acceleration is first written as an input, so that the coupling to another axis can be added to it.
    system = System((*states, "force", "command", "bearing"), _SECOND, lean=True)
    position, held, bearing = (system.signal(name) for name in (mechanics.MOTION[0], "force", "bearing"))

    def corrected(place: str, signal: np.ndarray) -> np.ndarray:
        return signal + free.linear(system, values, place, signal) if freely else signal

    _, through = saturation.slopes(values)
    asked = through[:, None] * corrected("free_command", system.signal("command"))
    current = amplifier.coil_current(system, values, asked)
    pulling = corrected("free_current", actuator.pulling_current(system, values, current))
    pushed = actuator.force(values, pulling, position) + mechanics.support(system, values)
    if freely:
        pushed = pushed - free.linear(system, values, "free_spring", position)
        pushed = pushed - free.linear(system, values, "free_damper", system.signal(mechanics.MOTION[1]))
    springs, outside = mechanics.springs(system, values) / values.mass[:, None], held / values.mass[:, None]
    mechanics.motion(system, values, bearing + outside)
    if sensors:
        reading = self_sensor.reading(system, sensors, position)
    else:
        reading = corrected("free_reading", sensor.reading(system, values, position, bearing, springs, outside))

    driven = system.a[0, :, -1]
    rates = system.a[0] + np.outer(driven, pushed[0] / values.mass)
    kept = np.flatnonzero(system.there[0, :-1])
    signals = (current[0], pulling[0], reading[0], driven)
    return LinearAxis(rates[np.ix_(kept, kept)], *(signal[kept] for signal in signals))


def cross_terms(e: Experiment, axis: int, other: Experiment) -> tuple[float, float, float, float]:
    """Coupling of the other axis into this one.

    The effect cross_coupling adds its share of the tangent of the other axis' magnets, centred and unsaturated.

    Args:
        e: one-axis experiment of this axis.
        axis: 0 (x) or 1 (y), this axis.
        other: one-axis experiment of the other axis.

    Returns:
        Stiffness (N/m), damping (N s/m), gain (N/A) and sensor share, as `Cross.onto`.
    """
    stiffness, damping, gain, sensor_share = e.rig.cross.onto(axis)
    if ratio := effect_value(e.effects, "cross_coupling"):
        own_gain, own_stiffness = (float(v[0]) for v in actuator.central_tangent(lane_values([other])))
        gain, stiffness = gain + ratio * own_gain, stiffness + ratio * own_stiffness
    return stiffness, damping, gain, sensor_share
