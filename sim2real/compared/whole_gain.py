"""The whole gain or stiffness of the magnets at a point: by the rig's own effect or the point's, and by a move within a
tolerance.

An effect at a point replaces the rig's own one, and a move within the tolerance of the same parameter then no longer
acts (see `experiment_at`). So a gain that is to differ a little from a point's must be written as the whole of it.
"""

from dataclasses import replace
from math import log, log1p

from maglev_env.experiment import Experiment
from maglev_env.loop.effect import EFFECTS, effect_value
from sim2real.compared.point import Point, experiment_at

GAIN, STIFFNESS = "actuator_gain", "negative_stiffness"
FORMS = {GAIN: "force_share", STIFFNESS: "distance_share"}  # share of the change in the form that is not the default
BOUNDS = EFFECTS[GAIN].parameters["change"]


def with_more_gain(e: Experiment, point: Point, share: float) -> tuple[Point, float]:
    """The point with an actuator that makes more force of the same command, because another current pulls.

    What scales the force in place of the current at the point, by the form of its gain, stays as it is. The gain is
    made smaller where a larger one would leave the range of the effect, or the range of its form.

    Args:
        e: The experiment on the nominal rig.
        point: The point.
        share: Relative change of the gain, above 0.

    Returns:
        The point with that gain, and the share with the sign that it has there.
    """
    whole, form = _whole(e, point)
    share = abs(share) if whole * (1 + share) - 1 <= BOUNDS.high and not (form and whole < 1) else -abs(share)
    if whole * (1 + share) - 1 < BOUNDS.low:
        share = -share
    return times_gain(e, point, 1 + share), share


def times_gain(e: Experiment, point: Point, factor: float) -> Point:
    """The point with a current that pulls larger by a factor; its gain stays in the range of the effect.

    Args:
        e: The experiment on the nominal rig.
        point: The point.
        factor: Above 0.
    """
    whole, form = _whole(e, point)
    there = min(max(whole * factor, 1 + BOUNDS.low), 1 + BOUNDS.high)
    more = {"change": there - 1}
    if form:
        more["force_share"] = min(max(form * log(whole) / log(there), 0.0), 1.0) if there != 1 else form
    return replace(point, effects={**point.effects, GAIN: more})


def both_forms(e: Experiment, point: Point, name: str, share: float) -> tuple[Point, Point, float]:
    """The point with a gain or stiffness that is a little another one, by the form that it has by default and by the
    other one.

    Args:
        e: The experiment on the nominal rig.
        point: The point.
        name: "actuator_gain" or "negative_stiffness".
        share: Relative change; its sign is the wanted one of a gain that is not below the stated one.

    Returns:
        Both points, and the change with the sign with which the form of the whole stays in its range.
    """
    whole, form = _whole(e, point, name)
    # What is off so far keeps its form, of which the change is a part on that side.
    more, change = share if whole >= 1 else -share, EFFECTS[name].parameters["change"]
    if not change.low <= whole * (1 + more) - 1 <= change.high:
        more = -more
    so_far, there = form * log(whole), whole * (1 + more)
    known = EFFECTS[name].parameters[FORMS[name]]
    forms = (min(max(s / log(there), known.low), known.high) for s in (so_far, so_far + log1p(more)))
    points = (replace(point, effects={**point.effects, name: {"change": there - 1, FORMS[name]: s}}) for s in forms)
    return *points, more


def _whole(e: Experiment, point: Point, name: str = GAIN) -> tuple[float, float]:
    """The whole gain or stiffness at a point, in units of that of the magnets, and its form."""
    alone = Point(*({k: v for k, v in of.items() if k == name} for of in (point.effects, point.changes)))
    here = experiment_at(e, alone).effects
    return 1 + effect_value(here, name), effect_value(here, name, FORMS[name])
