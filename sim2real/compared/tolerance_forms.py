"""A gain or a negative stiffness within its tolerance has no stated form: how the pull curves is then not known either.

By default the simulator scales the current that pulls, and the pull at rest over the gap. On a bench a gain is off
because the amplifier gives another current, or because every current pulls more; a stiffness, because the pull falls
off more or less steeply with the gap, and then the actuator gain varies otherwise with the gap, too. Between opposed
magnets these differ by the square of the motion (7e-4 of the gain for 5 % of the gap and 3 % of stiffness, which long
records tell). Below a single magnet they make harmonics that stand far above the noise. So what one form has and the
other has not is a nuisance of one standard deviation of the tolerance. It is looked at near the best known parameters:
a loop whose gain is 5 % less answers to it otherwise, by more than the noise of a long recording. Where a pair of
magnets moves the rotor over a third of the gap, the nuisance is so large that its own curvature shows: there the two
quantities behind both forms, the bias current and the gap, are fitted as tolerances are.

An amplifier's lag has no stated form either. Its time constant says by how much the current comes later; that it does
so through a single pole is the model's. A current loop has two or three. Without this nuisance, an effect beside such a
lag leaves more than noise between command and current, for which no name but an unknown cause is left.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.loop.axes import AXES
from maglev_env.loop.effect import effect_value
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import SingleSidedLaw, linearise, reshaped
from maglev_env.rig.rig import Rig, axis_rig
from sim2real.compared.law_shape import possible
from sim2real.compared.point import MADE_OF, NOMINAL, Point, experiment_at
from sim2real.compared.simulated import Predictor
from sim2real.compared.whole_gain import GAIN, STIFFNESS, both_forms
from sim2real.recorded.nuisances import Nuisances

LAG = "amplifier_time_constant"
OF = "form of "  # begins the name of a nuisance; that of the parameter follows
# Standard deviations by which a gain or stiffness is off in either form, for what that does: as far as it often is. By
# a tenth nothing is seen of the curvature that a ball shows, and by a whole one a loop is another one.
LITTLE = 0.3
SHOWN = 10.0  # standard deviations of the noise by which one of a form's changes the recordings for it to bend
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
        for share in (LITTLE * sigma, -LITTLE * sigma):  # a law at the end of its range bends the other way
            scaled, _, more = both_forms(e, near, STIFFNESS, share)
            bent = {"exponent": exponent + more * stiffness / steeper, "offset": offset}
            if possible(**bent):
                found[STIFFNESS] = scaled, replace(near, effects={**near.effects, "force_law": bent}), more / sigma
                break
    return found


def form_tolerances(nuisances: Nuisances, rig: Rig) -> dict[str, float]:
    """Relative standard deviations of what gain and stiffness of a pair of magnets are made of, where it shows.

    Another bias current at the same gain and stiffness is another form of both, another gap one of the stiffness. Where
    a rig states a geometry instead, gain and stiffness are held at what that gives (`experiment_at`).

    Args:
        nuisances: Of the campaign, with the forms.
        rig: The nominal rig.
    """
    gain, stiffness = (rig.tolerance.get(name, 0.0) for name in (GAIN, STIFFNESS))
    by_name = zip(nuisances.names, nuisances.columns, strict=True)
    forms = [column for name, column in by_name if name.startswith((OF + GAIN, OF + STIFFNESS))]
    stated = all(getattr(rig, name) is not None for name in (GAIN, STIFFNESS))
    if (
        (rig.per_axis and not stated)
        or "pair" not in rig.capabilities
        or max(map(np.linalg.norm, forms), default=0.0) < SHOWN
    ):
        return {}
    # Stiffness over gain is bias current over gap. At a stated gain the pull goes with the bias current squared.
    either = float(np.hypot(gain, stiffness))
    own = dict(zip(MADE_OF, (either / 2, either), strict=True))
    return {n: sd for n, sd in own.items() if sd and getattr(rig, n) and n not in rig.tolerance}


def form_nuisances(
    e: Experiment, near: Point, predictor: Predictor, law_is_sure: bool, lag_is_sure: bool
) -> Mapping[str, np.ndarray]:
    """What differs between both forms in a record's residuals (outputs, axes, n), by the nuisance's name.

    Each of two axes has magnets and an amplifier of its own, which are off in forms of their own.
    """
    forms = tolerance_forms(e, near, law_is_sure, lag_is_sure)
    if not forms:
        return {}
    predicted = predictor([point for *pair, _ in forms.values() for point in pair])
    changes = zip(forms.items(), predicted[1::2] - predicted[::2], strict=True)
    whole = {OF + name: change / sds for (name, (*_, sds)), change in changes if np.isfinite(change).all()}
    if e.rig.axes == 1:
        return whole
    axes = np.eye(e.rig.axes)[:, :, None]
    return {f"{name} along {AXES[i]}": own * change for name, change in whole.items() for i, own in enumerate(axes)}
