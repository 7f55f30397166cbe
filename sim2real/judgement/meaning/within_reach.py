"""Whether recordings show the limit without which an effect is linear and has another name.

Bristles that only bend are a spring in series with a damper. Anything that creeps is one too, a cable or a rubber
mount, and so is a weak echo of the motion. What tells friction is that its force has a limit. Likewise, a hysteresis
whose width no current reaches lags by nothing and is a smaller gain, or under ripple a lag in time. A dead band whose
edges are rounded over more than any command is a smaller gain, too. A fit which explains no less with a limit that is
out of reach has found something linear under the effect's name.

Where a fit leaves noise alone, it is enough that noise cannot have made what the limit saves. Of friction whose
bristles bend as far as the rotor mostly moves, and of a hysteresis under ripple, which wipes out most of the loop, only
a small part is bent. What is linear, and not just a spring in series with a damper, leaves more. A hysteresis that
shows nothing but its lag in time is still one where the noise of the recordings makes the ripple (`under_noise.py`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.loop.effect import EFFECTS
from sim2real.compared.point import Point
from sim2real.compared.problem import Problem
from sim2real.judgement.dispersion import NOISE_INFLATION
from sim2real.judgement.meaning.under_noise import ripple_is_noise
from sim2real.search.fit import LEFT_SD, Fit
from sim2real.search.fitting import CALIBRATION_STEP, STEP, aside
from sim2real.search.following import following


@dataclass(frozen=True)
class Limit:
    """The limit of an effect, without which that is linear.

    Attributes:
        scaled: Parameters which, multiplied by the same factor, keep what it does to a small motion; the first of them
            is the limit.
        rival: The linear effect that is the nearest: what the limit explains is weighed against what is explained
            beyond it.
        without: What the effect is without its limit, in words.
    """

    scaled: tuple[str, ...]
    rival: str
    without: str


LIMITS: Mapping[str, Limit] = {
    "friction": Limit(("force", "velocity", "presliding", "stribeck"), "damping", "a spring in series with a damper"),
    "hysteresis": Limit(("width", "ripple"), "actuator_gain", "a smaller gain or, under ripple, a lag"),
    "deadband": Limit(("half_width", "rounding"), "actuator_gain", "a smaller gain"),
}
# Such a factor: the limit is then out of reach. At the end of the range of the effect it is less, but the fit has then
# followed the recordings as far as it could to where there is no limit.
FAR = 100.0
SHOWN, SURELY = 0.05, 6.0  # share of what the effect saves, and cost, that its limit must save at least
# Cost, in units of the reduced chi-square, that the limit of a fit which leaves noise alone must save.
BEYOND_NOISE = 20.0


def shows_limit(problem: Problem, fit: Fit, name: str, without: float) -> bool:
    """Whether the limit of an effect in a fit explains a share of what the effect does.

    Args:
        problem: The recordings.
        fit: A hypothesis with its Jacobian; True without one.
        name: One of its effects that is among LIMITS.
        without: Cost of the same hypothesis without the effect, or with its rival instead.
    """
    if fit.jacobian is None or not np.isfinite(without):
        return True
    cost = _without_limit(problem, fit, name)
    if cost is None:
        return True
    share, count = SHOWN * (without - fit.cost), 2.0 * problem.data.size
    noise_alone = fit.cost < count + LEFT_SD * NOISE_INFLATION * np.sqrt(2.0 * count)
    ripple = fit.hypothesis.point(fit.u).effects[name].get("ripple")
    if ripple or noise_alone:
        share = min(share, BEYOND_NOISE * max(fit.cost / count, 1.0))
    if cost - fit.cost > max(share, SURELY):
        return True
    return bool(ripple) and ripple_is_noise(problem, fit, name, SHOWN * (without - fit.cost))


def _without_limit(problem: Problem, fit: Fit, name: str) -> float | None:
    """Cost of a fit in which nothing reaches the limit of one effect, with all else following to first order; None
    where the rotor touches down.

    The effect's own parameters follow as they act there: as they act within the limit, its strength alone would bring
    back all that the limit does.
    """
    h, scaled, card = fit.hypothesis, LIMITS[name].scaled, EFFECTS[name].parameters
    known = {key: card[key].default for key in scaled}
    sizes = known | h.point(fit.u).effects[name]
    factor = min([FAR, *(card[key].high / sizes[key] for key in scaled if sizes[key])])

    def never(u: np.ndarray) -> Point:
        at = h.point(u)
        values = known | at.effects[name]
        values |= {key: min(factor * values[key], card[key].high) for key in scaled}
        return Point({**at.effects, name: values}, at.changes, at.dithered)

    names = [(c.effect, c.parameter) for c in h.coordinates]
    names += [(h.shapes[key].effect, h.shapes[key].key) if key in h.shapes else ("", key) for key in h.calibrated]
    own = [i for i, (effect, key) in enumerate(names) if effect == name and key != scaled[0]]
    moved = [aside(fit, i, STEP if i < len(h.coordinates) else CALIBRATION_STEP) for i in own]
    linear, *others = problem.simulate([never(u) for u in (fit.u, *moved)])
    if not np.isfinite(linear).all():
        return None
    jacobian = fit.jacobian.copy()
    for i, u, predicted in zip(own, moved, others, strict=True):
        told = np.isfinite(predicted).all() and u[i] != fit.u[i]
        jacobian[i] = (predicted - linear) / (u[i] - fit.u[i]) if told else 0.0
    # The limit itself would come back.
    free = np.array([each != (name, scaled[0]) for each in names])
    return following(replace(fit, jacobian=jacobian), free).cost(linear - (problem.data - fit.residual))
