"""How many integration steps a control sample needs: more than one where an effect is fast for the control rate."""

from math import ceil

import numpy as np

from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.lane_values import lane_values
from maglev_env.loop import actuator, mechanics
from maglev_env.loop.further import springs

MOST_TURN = 0.1  # rad on the rotor's own stiffness; the error of a step is then below 1e-6 of the motion
# A step of an effect is as long as this share of its time constant at most, and of a radian of its swing. Friction is
# then right within 3e-4; a stop, which begins at once, needs more.
FRICTION_STEP, SPRING_STEP = 0.5, 0.25
# No effect asks for more steps than bring them to those of a loop at this rate (Hz), which is never divided; they are
# then at least half as long as its own. What is faster is held back as of such a loop: see `mechanics.fill` and
# `springs.fill`.
FAST = 5000.0
FAST_EFFECTS = frozenset({"friction", *springs.EFFECTS})


def steps_on_stiffness(e: Experiment) -> int:
    """Integration steps per control sample, in each of which the rotor turns by MOST_TURN at most on its stiffness."""
    values = lane_values([axis_experiment(e, axis) for axis in range(e.rig.axes)])
    stiffness = abs(actuator.central_tangent(values)[1]) + values.rig("support_stiffness")
    turn = float(np.sqrt(stiffness / values.mass).max()) / e.rig.control_rate
    return max(1, ceil(turn / MOST_TURN))


def steps_on_effects(e: Experiment) -> int:
    """Integration steps per control sample that follow the fastest effect; 1 of a loop that is FAST itself."""
    rate = e.rig.control_rate
    if rate >= FAST or FAST_EFFECTS.isdisjoint(e.effects):
        return 1
    values = lane_values([axis_experiment(e, axis) for axis in range(e.rig.axes)])
    friction, spring = mechanics.friction_rate(values).max(), springs.spring_rate(values).max()
    needed = max(friction / FRICTION_STEP, spring / SPRING_STEP)
    return max(1, ceil(min(needed, FAST) / rate))
