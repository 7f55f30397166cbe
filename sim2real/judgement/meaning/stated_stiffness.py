"""What a stated negative stiffness costs an effect that changes it by another name than its own.

The effect `negative_stiffness` pays for leaving the tolerance that the rig states of it (see `hypotheses.WIDER`). A
force law that falls off otherwise has another stiffness at rest, too, and while the motion is small nothing else: it
pays the same. Otherwise a stiffness far from what is stated would always be called a force law.
"""

from maglev_env.loop.effect import effect_value
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise, reshaped
from maglev_env.rig.rig import Rig, axis_rig
from sim2real.compared.point import Point
from sim2real.search.hypotheses import WIDER

LAW, STIFFNESS = "force_law", "negative_stiffness"


def stiffness_cost(point: Point, rig: Rig) -> float:
    """Cost of the change of stiffness at rest that a point's force law makes; 0 without a stated tolerance.

    Args:
        point: the point.
        rig: the nominal rig.
    """
    sigma = rig.tolerance.get(STIFFNESS, 0.0)
    if LAW not in point.effects or STIFFNESS in point.effects or not sigma:
        return 0.0
    nominal = force_law(axis_rig(rig, 0))
    other = reshaped(nominal, *(effect_value(point.effects, LAW, key) for key in ("exponent", "offset")))
    (_, was), (_, now) = linearise(nominal), linearise(other)
    return ((now / was - 1) / (WIDER * sigma)) ** 2
