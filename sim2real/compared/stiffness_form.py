"""A negative stiffness within its tolerance has no stated form: how the pull curves is then not known either.

By default the simulator scales the pull at rest over the gap. On a bench a stiffness is off because the pull falls off
more or less steeply with the gap, and then the actuator gain varies otherwise with the gap, too. Of opposed magnets
these terms cancel while the motion is small. Below a single magnet they make harmonics that stand far above the noise,
so what one form has and the other has not is a nuisance of one standard deviation of the tolerance.
"""

from collections.abc import Mapping

import numpy as np

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import SingleSidedLaw, linearise, reshaped
from maglev_env.rig.rig import Rig
from sim2real.compared.simulated import Point, Predictor

NAME = "negative_stiffness"


def stiffness_forms(rig: Rig) -> tuple[Point, Point] | None:
    """The rig with a stiffness off by one standard deviation in either form; None where none is stated, or where
    opposed magnets pull."""
    sigma = rig.tolerance.get(NAME, 0.0)
    law = force_law(rig) if sigma else None
    if not isinstance(law, SingleSidedLaw):
        return None
    stiffness = linearise(law)[1]
    steeper = linearise(reshaped(law, 1.0, 0.0))[1] - stiffness  # for an exponent that is larger by one
    return Point({}, {NAME: sigma}), Point({"force_law": {"exponent": sigma * stiffness / steeper, "offset": 0.0}}, {})


def stiffness_nuisance(rig: Rig, predictor: Predictor) -> Mapping[str, np.ndarray]:
    """What differs between both forms in a record's residuals (outputs, axes, n), by the nuisance's name."""
    forms = stiffness_forms(rig)
    if forms is None:
        return {}
    scaled, steeper = predictor(forms)
    change = steeper - scaled
    return {f"form of {NAME}": change} if np.isfinite(change).all() else {}
