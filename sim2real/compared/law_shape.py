"""What is not known of the shape of a magnet's force law, where it shows: below one magnet, or in a large motion.

Gain and stiffness at rest are fitted; how both change along the motion follows from the law that the rig states. A
real pole has another one: exponential where the coil is long, nearer to a square where the gap is small. Harmonics and
rectified steps would then tell gain and stiffness with an error that their noise does not know of, and an effect that
happens to bend the pull would be named beside another gain. Of opposed magnets that cancels while the motion is small.

The current at which a suspended mass rests is not known exactly either: every recording is balanced by the nominal law
(`weight_law.balancing`), and offsets of a thousandth are anybody's. How gain and stiffness change between the place
where that law rests and the true one would weigh the mass, to a hundredth of what scales can.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from maglev_env.lane_values import shaped_law
from maglev_env.loop.effect import EFFECTS, effect_value
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw, linearise
from maglev_env.rig.rig import Rig, axis_rig, with_parameters
from sim2real.compared.point import TOLERANCE_EFFECTS, Point
from sim2real.recorded.along_motion import NEAREST
from sim2real.recorded.at_rest.static_evidence import can_rest
from sim2real.recorded.open_record import OpenRecord

# One standard deviation. From a square to an exponential of the same steepness are two of FORM, which doubles the
# exponent of the distance and the distance itself; STEEPNESS is that of the change of the gain with the gap.
FORM, STEEPNESS = 1.0, 0.1
BEND = 0.25  # standard deviations of a shape, for its direction at a law that is bent already
FORM_NAME, STEEPNESS_NAME = "form of the force law", "steepness of the force law"
# One standard deviation of the current at rest, in that current.
REST = 0.01
ROOM = 0.1  # of the gap: least distance that a bent law may leave
# What keeps gain and stiffness; what a shape asks for ends at its bounds.
SCALED = {name: EFFECTS[name].parameters["change"] for name in ("actuator_gain", "negative_stiffness")}


def shows_shape(record: OpenRecord) -> bool:
    """Whether the shape of the law shows in a recording without a period."""
    if not record.nominal.controlled:
        return False
    return record.along is not None or isinstance(force_law(axis_rig(record.nominal, 0)), SingleSidedLaw)


def shape_directions(rig: Rig) -> Mapping[str, tuple[float, float]]:
    """What one standard deviation of each unknown of the law's shape adds to exponent and offset of `force_law`."""
    law = force_law(axis_rig(rig, 0))
    exponent, offset = (effect_value(rig.effects, "force_law", name) for name in ("exponent", "offset"))
    power, distance = _pull(shaped_law(law, rig.effects))
    # The sign of what is unsure does not matter. Where a change leaves the range of the law, its opposite is taken.
    longer = max(power, 1.0) * FORM, FORM * distance / law.gap
    shorter = tuple(-change * FORM / (1 + FORM) for change in (power, distance / law.gap))
    steeper = 0.0, -STEEPNESS * distance / law.gap
    return {
        FORM_NAME: longer if possible(exponent + longer[0], offset + longer[1]) else shorter,
        STEEPNESS_NAME: steeper if possible(exponent, offset + steeper[1]) else (0.0, -steeper[1]),
    }


def bent(rig: Rig, amounts: Mapping[str, float]) -> Rig:
    """A rig whose law is bent by amounts of `shape_directions`, with its gain and stiffness at rest; the rig itself
    where a law cannot have that shape."""
    law, centre = force_law(axis_rig(rig, 0)), effect_value(rig.effects, "eccentricity")
    shape = {name: effect_value(rig.effects, "force_law", name) for name in ("exponent", "offset")}
    ways = shape_directions(rig)
    for name, directions in ways.items():
        for key, change in zip(shape, directions, strict=True):
            shape[key] += amounts.get(name, 0.0) * change
    further = (
        tuple(at + BEND * change for at, change in zip(shape.values(), way, strict=True)) for way in ways.values()
    )
    if not all(possible(*one) for one in (tuple(shape.values()), *further)):
        return rig  # it is asked from there which way it bends on (`law_shapes`)
    effects = {**rig.effects, "force_law": shape}
    plain, was, now = linearise(law), *(linearise(shaped_law(law, own), centre) for own in (rig.effects, effects))
    if any(a * b <= 0 for a, b in zip(was, now, strict=True)):
        return rig  # it pushes where it pulled
    kept = {name: value * a / b for name, value, a, b in zip(SCALED, plain, was, now, strict=True)}
    return replace(with_parameters(rig, kept), effects=effects)


def with_bent_law(record: OpenRecord, amounts: Mapping[str, float]) -> OpenRecord:
    """The record of a rig whose law is bent, see `bent`."""
    own = bent(record.nominal, amounts)
    if own is record.nominal or not _has_room(record, own):
        return record
    kept = {name: getattr(own, name) for name in SCALED}
    rig = record.experiment.rig
    simulated = replace(with_parameters(rig, kept), effects={**rig.effects, "force_law": own.effects["force_law"]})
    return replace(record, nominal=own, experiment=replace(record.experiment, rig=simulated))


def _has_room(record: OpenRecord, rig: Rig) -> bool:
    """Whether the distance in a bent law stays well above zero all along the motion, also where a simulation strays."""
    law = force_law(axis_rig(rig, 0))
    nearest = 1 - min(1.5 * float(np.abs(record.series["displacement"]).max()) / law.gap, NEAREST)
    own = law.coil_gap / law.gap if isinstance(law, SingleSidedLaw) else 0.0
    return nearest + own + effect_value(rig.effects, "force_law", "offset") > ROOM


def law_shapes(
    rig: Rig, near: Point, directions: Mapping[str, tuple[float, float]] | None = None, step: float = 1.0
) -> Mapping[str, Point]:
    """Points that differ by a step, in standard deviations, of what is not known of the law's shape.

    Gain and stiffness at rest are those of `near`.

    Args:
        rig: the nominal rig, with magnets.
        near: the point from which they differ.
        directions: as `shape_directions` gives them; those of the rig itself by default.
        step: in standard deviations.
    """
    law = force_law(axis_rig(rig, 0))
    effects_here = {**rig.effects, **near.effects}
    exponent, offset = (effect_value(effects_here, "force_law", name) for name in ("exponent", "offset"))
    here = shaped_law(law, effects_here)
    changes = shape_directions(replace(rig, effects=effects_here)) if directions is None else directions
    centre = effect_value(effects_here, "eccentricity")  # the rotor rests there, seen from the magnets
    gain, stiffness = linearise(here, centre)
    # A change within a tolerance counts as long as no effect of its name stands beside it (see `experiment_at`).
    within = {TOLERANCE_EFFECTS[name]: value for name, value in near.changes.items() if name in TOLERANCE_EFFECTS}
    within = {name: value for name, value in within.items() if name not in near.effects}
    held = {name: (1 + effect_value(effects_here, name)) * (1 + within.get(name, 0.0)) for name in SCALED}
    found = {}
    for name, (more, further) in changes.items():
        other = {"exponent": exponent + step * more, "offset": offset + step * further}
        own = linearise(shaped_law(law, {**effects_here, "force_law": other}), centre)
        same = {}
        for (scaled, bounds), was, now in zip(SCALED.items(), (gain, stiffness), own, strict=True):
            same_size = was / now if now else 1.0  # a stiffness that is stated as none stays none
            change = min(max(held[scaled] * same_size - 1, bounds.low), bounds.high)
            same[scaled] = {**effects_here.get(scaled, {}), "change": change}
        effects = {**near.effects, "force_law": other, **same}
        found[name] = Point(effects, near.changes, near.dithered)
    return found


def rest_current(record: OpenRecord, near: Point) -> Mapping[str, Point]:
    """A point at which the mass of a balanced recording rests under another current, by the name of that nuisance."""
    law = force_law(axis_rig(record.nominal, 0)) if record.nominal.controlled else None
    if record.source is None or not isinstance(law, SingleSidedLaw) or not can_rest(record.nominal):
        return {}
    own = effect_value({**record.nominal.effects, **near.effects}, "actuator_offset", "current")
    moved = {"current": own + REST * law.bias_current}
    return {f"current at rest of {record.name}": replace(near, effects={**near.effects, "actuator_offset": moved})}


def possible(exponent: float, offset: float) -> bool:
    """Whether a force law may have these parameters."""
    of_law = EFFECTS["force_law"].parameters
    return all(of_law[k].low <= v <= of_law[k].high for k, v in (("exponent", exponent), ("offset", offset)))


def _pull(law: ForceLaw | SingleSidedLaw) -> tuple[float, float]:
    """Exponent of the distance in a coil's pull, and the distance at rest, m."""
    power = law.exponent + (2.0 if isinstance(law, ForceLaw) else 0.0)
    return power, law.gap + law.coil_gap


def shape_columns(at: np.ndarray, moved: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
    """Change of coordinates by each standard deviation; zero where the rotor touches down there."""
    return {name: np.where(np.isfinite(own).all(), own - at, 0.0) for name, own in moved.items()}
