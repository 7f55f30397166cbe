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
from math import expm1, log1p

import numpy as np

from maglev_env.loop.effect import effect_value
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
        law_is_sure: False: how the pull curves along the gap is a nuisance of its own, about the rig as it is stated,
            which has the forms of the stiffness.
        lag_is_sure: False: the amplifier's lag may have another form than the stated one.
    """
    if not rig.controlled:
        return {}
    found = {}
    if not lag_is_sure and rig.amplifier_time_constant and rig.tolerance.get(LAG) != 0.0:
        own = rig.effects.get("amplifier_lag", {})
        second = own.get("time_constant", 0.0) + SECOND_POLE * rig.amplifier_time_constant
        found[LAG] = NOMINAL, Point({"amplifier_lag": {**own, "time_constant": second}}, {LAG: -SECOND_POLE})
    if sigma := rig.tolerance.get(GAIN, 0.0):
        found[GAIN] = _scaled_or(GAIN, "force_share", rig, sigma)
    law, sigma = force_law(axis_rig(rig, 0)), rig.tolerance.get(STIFFNESS, 0.0)
    if not sigma:
        return found
    if not isinstance(law, SingleSidedLaw):
        found[STIFFNESS] = _scaled_or(STIFFNESS, "distance_share", rig, sigma)
    elif law_is_sure:
        exponent, offset = (effect_value(rig.effects, "force_law", name) for name in ("exponent", "offset"))
        stiffness, other = (linearise(reshaped(law, exponent + more, offset))[1] for more in (0.0, 1.0))
        steeper = other - stiffness  # for an exponent that is larger by one
        bent = {"exponent": exponent + sigma * stiffness / steeper, "offset": offset}
        found[STIFFNESS] = Point({}, {STIFFNESS: sigma}), Point({"force_law": bent}, {})
    return found


def _scaled_or(name: str, form: str, rig: Rig, sigma: float) -> tuple[Point, Point]:
    """A gain or stiffness that is off by one standard deviation of its tolerance, in the form that the rig has, and in
    the one that is further from that.

    The rig may be off already by an effect of its own, of which `form` is the share in the other form. The tolerance
    is about that value, on the side on which the share of both together stays in its range.
    """
    own, share = (effect_value(rig.effects, name, key) for key in ("change", form))
    before, more = log1p(own), log1p(sigma if own >= 0 else -sigma)
    together = (share * before + (more if share < 0.5 else 0.0)) / (before + more)
    return Point({}, {name: expm1(more)}), Point({name: {"change": expm1(before + more), form: together}}, {})


def form_nuisances(rig: Rig, predictor: Predictor, law_is_sure: bool, lag_is_sure: bool) -> Mapping[str, np.ndarray]:
    """What differs between both forms in a record's residuals (outputs, axes, n), by the nuisance's name."""
    forms = tolerance_forms(rig, law_is_sure, lag_is_sure)
    if not forms:
        return {}
    predicted = predictor([point for pair in forms.values() for point in pair])
    changes = zip(forms, predicted[1::2] - predicted[::2], strict=True)
    return {f"form of {name}": change for name, change in changes if np.isfinite(change).all()}
