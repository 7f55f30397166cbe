"""A gain or a negative stiffness within its tolerance has no stated form: how the pull curves is then not known either.

By default the simulator scales the current that pulls, and the pull at rest over the gap. On a bench a gain is off
because the amplifier gives another current, or because every current pulls more; a stiffness, because the pull falls
off more or less steeply with the gap, and then the actuator gain varies otherwise with the gap, too. Between opposed
magnets these differ by the square of the motion (7e-4 of the gain for 5 % of the gap and 3 % of stiffness, which long
records tell). Below a single magnet they make harmonics that stand far above the noise. So what one form has and the
other has not is a nuisance of one standard deviation of the tolerance. It is looked at near the best known parameters:
a loop whose gain is 5 % less answers to it otherwise, by more than the noise of a long recording.

An amplifier's lag has no stated form either. Its time constant says by how much the current comes later; that it does
so through a single pole is the model's. A current loop has two or three. Without this nuisance, an effect beside such a
lag leaves more than noise between command and current, for which no name but an unknown cause is left.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.loop.effect import effect_value
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import SingleSidedLaw, linearise, reshaped
from maglev_env.rig.rig import axis_rig
from sim2real.compared.point import NOMINAL, Point, experiment_at
from sim2real.compared.simulated import Predictor
from sim2real.compared.whole_gain import GAIN, STIFFNESS, both_forms

LAG = "amplifier_time_constant"
# Standard deviations by which a gain or stiffness is off in either form, for what that does: as far as it often is. By
# a tenth nothing is seen of the curvature that a ball shows, and by a whole one a loop is another one.
LITTLE = 0.3
SECOND_POLE = 0.2  # share of a stated lag that is a second pole: one standard deviation of its form


def tolerance_forms(
    e: Experiment, near: Point = NOMINAL, law_is_sure: bool = True, lag_is_sure: bool = True
) -> Mapping[str, tuple[Point, Point, float]]:
    """Two points near one that what a rig states does not tell apart, and by how many standard deviations they are off,
    by the parameter's name.

    A gain or a stiffness is off by LITTLE in either form. The amplifier's lag is as long as stated.

    Args:
        e: The experiment on the nominal rig.
        near: The best known parameters.
        law_is_sure: False: how the pull curves along the gap is a nuisance of its own, about the rig as it is stated,
            which has the forms of the stiffness.
        lag_is_sure: False: the amplifier's lag may have another form than the stated one.
    """
    rig = e.rig
    if not rig.controlled:
        return {}
    found = {}
    if not lag_is_sure and rig.amplifier_time_constant and rig.tolerance.get(LAG) != 0.0:
        own = rig.effects.get("amplifier_lag", {})
        second = own.get("time_constant", 0.0) + SECOND_POLE * rig.amplifier_time_constant
        found[LAG] = NOMINAL, Point({"amplifier_lag": {**own, "time_constant": second}}, {LAG: -SECOND_POLE}), 1.0
    if sigma := rig.tolerance.get(GAIN, 0.0):
        *forms, more = both_forms(e, near, GAIN, LITTLE * sigma)
        found[GAIN] = *forms, more / sigma
    law, sigma = force_law(axis_rig(rig, 0)), rig.tolerance.get(STIFFNESS, 0.0)
    if not sigma:
        return found
    if not isinstance(law, SingleSidedLaw):
        *forms, more = both_forms(e, near, STIFFNESS, LITTLE * sigma)
        found[STIFFNESS] = *forms, more / sigma
    elif law_is_sure:
        here = experiment_at(e, near).effects
        exponent, offset = (effect_value(here, "force_law", name) for name in ("exponent", "offset"))
        stiffness, other = (linearise(reshaped(law, exponent + more, offset))[1] for more in (0.0, 1.0))
        steeper = other - stiffness  # for an exponent that is larger by one
        scaled, _, more = both_forms(e, near, STIFFNESS, LITTLE * sigma)
        bent = {"exponent": exponent + more * stiffness / steeper, "offset": offset}
        found[STIFFNESS] = scaled, replace(near, effects={**near.effects, "force_law": bent}), more / sigma
    return found


def form_nuisances(
    e: Experiment, near: Point, predictor: Predictor, law_is_sure: bool, lag_is_sure: bool
) -> Mapping[str, np.ndarray]:
    """What differs between both forms in a record's residuals (outputs, axes, n), by the nuisance's name."""
    forms = tolerance_forms(e, near, law_is_sure, lag_is_sure)
    if not forms:
        return {}
    predicted = predictor([point for *pair, _ in forms.values() for point in pair])
    changes = zip(forms.items(), predicted[1::2] - predicted[::2], strict=True)
    return {f"form of {name}": change / sds for (name, (*_, sds)), change in changes if np.isfinite(change).all()}
