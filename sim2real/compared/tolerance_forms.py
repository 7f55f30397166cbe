"""A gain or a negative stiffness within its tolerance has no stated form: how the pull curves is then not known either.

By default the simulator scales the current that pulls, and the pull at rest over the gap. On a bench a gain is off
because the amplifier gives another current, or because every current pulls more; a stiffness, because the pull falls
off more or less steeply with the gap, and then the actuator gain varies otherwise with the gap, too. Between opposed
magnets these differ by the square of the motion (7e-4 of the gain for 5 % of the gap and 3 % of stiffness, which long
records tell). Below a single magnet they make harmonics that stand far above the noise. So what one form has and the
other has not is a nuisance of one standard deviation of the tolerance.

An amplifier's lag has no stated form either. Its time constant says by how much the current comes later; that it does
so through a single pole is the model's. A current loop has two or three. Without this nuisance, an effect beside such a
lag leaves more than noise between command and current, for which no name but an unknown cause is left.
"""

from collections.abc import Mapping

import numpy as np

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import SingleSidedLaw, linearise, reshaped
from maglev_env.rig.rig import Rig, axis_rig
from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.simulated import Predictor

GAIN, STIFFNESS, LAG = "actuator_gain", "negative_stiffness", "amplifier_time_constant"
SECOND_POLE = 0.2  # share of a stated lag that is a second pole: one standard deviation of its form


def tolerance_forms(rig: Rig, law_is_sure: bool = True, lag_is_sure: bool = True) -> Mapping[str, tuple[Point, Point]]:
    """The rig in two forms that what it states does not tell apart, by the parameter's name.

    A gain or a stiffness is off by one standard deviation in either form. The amplifier's lag is as long as stated.

    Args:
        rig: The nominal rig.
        law_is_sure: False: how the pull curves along the gap is a nuisance of its own, which has the forms of the
            stiffness.
        lag_is_sure: False: the amplifier's lag may have another form than the stated one.
    """
    if not rig.controlled:
        return {}
    found = {}
    if not lag_is_sure and rig.amplifier_time_constant and rig.tolerance.get(LAG) != 0.0:
        second = {"time_constant": SECOND_POLE * rig.amplifier_time_constant}
        found[LAG] = NOMINAL, Point({"amplifier_lag": second}, {LAG: -SECOND_POLE})
    if sigma := rig.tolerance.get(GAIN, 0.0):
        found[GAIN] = Point({}, {GAIN: sigma}), Point({GAIN: {"change": sigma, "force_share": 1.0}}, {})
    law, sigma = force_law(axis_rig(rig, 0)), rig.tolerance.get(STIFFNESS, 0.0)
    if not sigma:
        return found
    if not isinstance(law, SingleSidedLaw):
        found[STIFFNESS] = (
            Point({}, {STIFFNESS: sigma}),
            Point({STIFFNESS: {"change": sigma, "distance_share": 1.0}}, {}),
        )
    elif law_is_sure:
        stiffness = linearise(law)[1]
        steeper = linearise(reshaped(law, 1.0, 0.0))[1] - stiffness  # for an exponent that is larger by one
        bent = {"exponent": sigma * stiffness / steeper, "offset": 0.0}
        found[STIFFNESS] = Point({}, {STIFFNESS: sigma}), Point({"force_law": bent}, {})
    return found


def form_nuisances(rig: Rig, predictor: Predictor, law_is_sure: bool, lag_is_sure: bool) -> Mapping[str, np.ndarray]:
    """What differs between both forms in a record's residuals (outputs, axes, n), by the nuisance's name."""
    forms = tolerance_forms(rig, law_is_sure, lag_is_sure)
    if not forms:
        return {}
    predicted = predictor([point for pair in forms.values() for point in pair])
    changes = zip(forms, predicted[1::2] - predicted[::2], strict=True)
    return {f"form of {name}": change for name, change in changes if np.isfinite(change).all()}
