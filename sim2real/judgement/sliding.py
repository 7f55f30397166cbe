"""Whether recordings show that friction slides.

Bristles that only bend are a spring in series with a damper. Anything that creeps is one too, a cable or a rubber
mount, and so is a weak echo of the motion. What tells friction is that its force has a limit: a fit of friction which
explains no less with a limit that no motion reaches has found something linear under its name.
"""

import numpy as np

from maglev_env.loop.effect import EFFECTS
from sim2real.compared.problem import Problem
from sim2real.compared.simulated import Point
from sim2real.search.fitting import Fit, real_product

FRICTION = "friction"
# Multiplied by the same factor, these keep the linear spring and damper, and what static friction makes of them.
LIMITED = ("force", "velocity", "presliding", "stribeck")
FAR, LEAST = 100.0, 3.0  # such a factor, if the bounds of the effect allow it: the limit is then out of reach
SHOWN = 0.05  # share of what friction saves, at least, that its limit must save


def slides(problem: Problem, fit: Fit, without: float) -> bool:
    """Whether the limit of the friction in a fit explains a share of what the friction does.

    Args:
        problem: The recordings.
        fit: A hypothesis with its Jacobian; True without one, or without friction.
        without: Cost of the same hypothesis without friction.
    """
    h, at = fit.hypothesis, fit.hypothesis.point(fit.u)
    if FRICTION not in h.effects or fit.jacobian is None or not np.isfinite(without):
        return True
    card = EFFECTS[FRICTION].parameters
    bristles = {key: card[key].default for key in LIMITED} | at.effects[FRICTION]
    factor = min([FAR, *(card[key].high / bristles[key] for key in LIMITED if bristles[key])])
    if factor < LEAST:
        return True
    bristles |= {key: factor * bristles[key] for key in LIMITED}
    never = Point({**at.effects, FRICTION: bristles}, at.changes, at.dithered)
    (linear,) = problem.data - problem.simulate([never])
    if not np.isfinite(linear).all():
        return True
    # All else follows, to first order, but for the coordinate that would bring the limit back.
    names = [(c.effect, c.parameter) for c in h.coordinates]
    free = np.array([name != (FRICTION, LIMITED[0]) for name in names] + [True] * len(h.calibrated))
    jacobian, prior, u = fit.jacobian[free], fit.prior[free], fit.u[free]
    normal = real_product(jacobian, jacobian) + np.diag(prior)
    gradient = real_product(jacobian, linear) - prior * u
    followed = gradient @ np.linalg.pinv(normal, hermitian=True) @ gradient
    cost = float(np.vdot(linear, linear).real + prior @ u**2 - followed)
    return cost - fit.cost > SHOWN * (without - fit.cost)
