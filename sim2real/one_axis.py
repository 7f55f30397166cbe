"""A campaign of two axes as one of a single axis, for what acts along that alone.

Every effect acts along both axes of a simulation alike. An amplifier that saturates along y, or friction along x, is
then an unknown cause, although each axis by itself shows what it is. Where the axes are not coupled, they are two rigs.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

from maglev_env.loop.axes import AXES
from maglev_env.loop.gains import of_axis
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.rig.excitation import axis_excitations
from maglev_env.rig.rig import axis_rig
from sim2real.report import sentence
from sim2real.result import Diagnosis


def of_one_axis(campaign: Campaign, axis: int) -> Campaign | None:
    """What a campaign holds of one axis (0: x, 1: y) of its rig; None where nothing to fit drives that axis.

    Recordings that drive the other axis alone are left out.
    """
    if campaign.rig is None:
        return None
    specs = tuple(own for spec in campaign.recordings if (own := _of_axis(spec, axis)) is not None)
    if not any(spec.role == "fit" for spec in specs):
        return None
    rig = replace(axis_rig(campaign.rig, axis), name=f"{campaign.rig.name}-{AXES[axis]}")
    return replace(campaign, rig=rig, recordings=specs, left_out=())


def _of_axis(spec: RecordingSpec, axis: int) -> RecordingSpec | None:
    """A recording's channels, controller and excitations of one axis; None where only the other one is driven."""
    excitations = axis_excitations(spec.excitations, axis)
    own, other = (f"_{AXES[i]}" for i in (axis, 1 - axis))
    if (spec.excitations and not excitations) or not any(name.endswith(own) for name in spec.channels):
        return None
    channels = {name.removesuffix(own): source for name, source in spec.channels.items() if not name.endswith(other)}
    gains = None if spec.gains is None else of_axis(spec.gains, axis)
    return replace(spec, gains=gains, excitations=excitations, channels=channels)


def along_one_axis(
    campaign: Campaign, shares: Mapping[str, float], diagnosed: Callable[[Campaign], Diagnosis]
) -> Diagnosis | None:
    """The diagnosis of the axis that has a named gap, where each axis by itself is sound or its gap has a name.

    Args:
        campaign: Of a rig with two axes, of which no known effect explains the gap.
        shares: Axis -> its share of the gap.
        diagnosed: Diagnoses a campaign.

    Returns:
        The diagnosis of the axis with the larger gap among those with a name, which says what the other one shows;
        None where an axis cannot be diagnosed alone, is unexplained, or where both are sound.
    """
    found: dict[str, Diagnosis] = {}
    for axis in sorted(range(len(AXES)), key=lambda i: -shares.get(AXES[i], 0.0)):
        own = of_one_axis(campaign, axis)
        if own is None:
            return None
        try:
            found[AXES[axis]] = diagnosed(own)
        except ValueError:  # it does not levitate alone, or tells nothing
            return None
        if found[AXES[axis]].verdict == "unexplained":
            return None
    named = [letter for letter, own in found.items() if own.verdict != "no_gap"]
    if not named:
        return None
    first = found[named[0]]
    others = [f"along {letter} alone: {sentence(own)}" for letter, own in found.items() if letter != named[0]]
    where = replace(first.where, axes={letter: float(letter == named[0]) for letter in AXES})
    return replace(first, axis=named[0], where=where, notes=(*others, *first.notes))
