"""A point of a search: effects and changes of parameters, the experiment that they make, how it is to be simulated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.loop.effect import EFFECTS, Effects, effect_value, meaningful
from maglev_env.rig.drawn import TANGENT, scaled_rig
from maglev_env.rig.rig import Rig, axis_rig
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record

# A tolerance of one of these parameters is a small effect of the given name.
TOLERANCE_EFFECTS = {card.nominal: name for name, card in EFFECTS.items() if card.nominal}
# What is another one along either axis, magnets, amplifiers, probes and springs, and what the name of its difference
# ends in. A tolerance is stated of both.
OF_EACH_AXIS, APART = (
    "actuator_gain", "negative_stiffness", "probe_gain", "amplifier_time_constant", "sensor_time_constant",
    "support_stiffness", "support_damping",
), " of y beyond that of x"  # fmt: skip
# What gain and stiffness of a pair of magnets are made of: of another one, both have another form.
MADE_OF = ("bias_current", "gap")
ROUNDED = 1e-9  # by which rounding takes a change beyond its range at most
RUNG_OUT = 6.5  # time constants after which the ringing of a mode is neglected
LASTING = (0, 0.5, 1, 2, 3, 4, 6, 9, 12)  # periods: points whose modes ring about as long are simulated together
# Sensor noise smooths hard nonlinearities (dithering). Limits are always smoothed; hysteresis and friction are smoothed
# in some forms and not in others.
DITHERED, MAY_BE_DITHERED = ({n for n, card in EFFECTS.items() if card.dither == how} for how in ("always", "maybe"))
HARD = DITHERED | MAY_BE_DITHERED


@dataclass(frozen=True)
class Point:
    """One set of parameters.

    Attributes:
        effects: Effects with their parameters.
        changes: Relative changes of the nominal rig's parameters within their tolerance.
        dithered: Whether sensor noise smooths the effects.
    """

    effects: Effects
    changes: Mapping[str, float]
    dithered: bool = False

    def smoothed(self, own: Effects) -> bool:
        """Whether noise, where there is any, smooths its effects, or those that the rig has of its own."""
        return self.dithered or not DITHERED.isdisjoint({*self.effects, *own})


NOMINAL = Point({}, {})


def experiment_at(e: Experiment, point: Point, made: dict[tuple, Rig] | None = None) -> Experiment:
    """The experiment on the rig that a point describes.

    Args:
        e: The experiment on the nominal rig.
        point: The point.
        made: Rigs by their changed parameters, to which new ones are added: many points differ in effects alone, and a
            rig is checked when it is made.
    """
    made = {} if made is None else made
    effects = {name: dict(values) for name, values in point.effects.items()}
    factors, apart, along_y = {}, {}, {}
    for name, change in point.changes.items():
        known = TOLERANCE_EFFECTS.get(name)
        if name.endswith(APART):
            own = name.removesuffix(APART)
            if own in TOLERANCE_EFFECTS:
                apart[TOLERANCE_EFFECTS[own]] = change
            else:
                along_y[own] = 1 + change
        elif known is None:
            factors[name] = 1 + change
        elif known not in effects:
            own = effect_value(e.rig.effects, known)  # a corrected rig may have this effect already
            whole = own + change + own * change
            bounds = EFFECTS[known].parameters["change"]
            if bounds.low - ROUNDED <= change <= bounds.high + ROUNDED:  # which rounding and the own change may leave
                whole = min(max(whole, bounds.low), bounds.high)
            effects[known] = {**e.rig.effects.get(known, {}), "change": whole}
    key = tuple(factors.items()), tuple(along_y.items())
    if key not in made:
        made[key] = _unlike(scaled_rig(_with_stated_tangent(e.rig, factors), factors) if factors else e.rig, along_y)
    return replace(e, rig=made[key], effects=effects, apart=apart)


def _with_stated_tangent(rig: Rig, factors: Mapping[str, float]) -> Rig:
    """The rig with gain and stiffness stated as its geometry gives them, where what they are made of is another form of
    them and not a tolerance of its own, which they follow."""
    if "pair" not in rig.capabilities or not any(name in factors and name not in rig.tolerance for name in MADE_OF):
        return rig
    return scaled_rig(rig, dict.fromkeys(TANGENT, 1.0))


def _unlike(rig: Rig, along_y: Mapping[str, float]) -> Rig:
    """The rig of two axes with parameters multiplied by factors along y alone."""
    if not along_y:
        return rig
    own = {name: getattr(axis_rig(rig, 1), name) * factor for name, factor in along_y.items()}
    return replace(rig, per_axis={**rig.per_axis, "y": {**rig.per_axis.get("y", {}), **own}})


def tolerances(rig: Rig) -> dict[str, float]:
    """Relative 1-sigma tolerances of the rig that a simulation can represent."""

    def simulated(name: str) -> bool:
        effect_of = TOLERANCE_EFFECTS.get(name)  # it changes what the law gives, too, where the rig states no value
        return bool(getattr(rig, name)) if effect_of is None else meaningful(effect_of, rig.capabilities)

    return {name: sigma for name, sigma in rig.tolerance.items() if sigma > 0 and simulated(name)}


def apart_tolerances(rig: Rig) -> dict[str, float]:
    """Relative 1-sigma differences between the axes of what each of two axes has of its own."""
    if rig.axes == 1:
        return {}
    return {name + APART: sigma for name, sigma in tolerances(rig).items() if name in OF_EACH_AXIS}


def unseen_by(record: Record | OpenRecord) -> frozenset[str]:
    """Effects that act before what drives the record."""
    return record.upstream if isinstance(record, OpenRecord) else frozenset()


def unseen_by_all(records: Sequence[Record | OpenRecord]) -> frozenset[str]:
    """Effects that act before what drives every one of the records."""
    return frozenset.intersection(*map(unseen_by, records))


def is_dithered(point: Point, rig: Rig) -> bool:
    """Whether the noise of a rig's sensor smooths what a point simulates, the rig's own effects included."""
    return rig.noise.displacement > 0 and point.smoothed(rig.effects)


def without_dithered(point: Point) -> Point:
    return Point({n: v for n, v in point.effects.items() if n not in HARD}, point.changes)


def with_own(point: Point, rig: Rig) -> Effects:
    """What acts at a point: its effects, and those of the rig's own that none of them replaces."""
    return {**rig.effects, **point.effects}


def modes_of(effects: Effects) -> list[Mapping[str, float]]:
    """Frequency and damping ratio of the second-order modes among effects."""
    found: list[Mapping[str, float]] = []
    for name, values in effects.items():
        if "damping_ratio" in values:
            found.append(values)
        if values.get("further_ratio"):
            times, damping = (effect_value(effects, name, f"further_{key}") for key in ("frequency", "damping"))
            found.append({"frequency": times * values["frequency"], "damping_ratio": damping})
    return found


def settling(point: Point) -> float:
    """Ringing time of the slowest mode among a point's effects, s; 0 without a mode."""
    rates = (2 * pi * mode["frequency"] * mode["damping_ratio"] for mode in modes_of(point.effects))
    return max((RUNG_OUT / rate for rate in rates), default=0.0)


def together(
    points: Sequence[Point], period: float, rig: Rig, anyway: float = 0.0
) -> list[tuple[tuple[float, bool], list[int]]]:
    """Points grouped by what can be simulated together.

    Args:
        points: The points.
        period: Excitation period, s.
        rig: The nominal rig, whose sensor noise may dither them.
        anyway: Time that all points are given to settle, s.

    Returns:
        ((settling time in s, whether noise dithers them), indices of the points) of each group.
    """
    steps = np.array(LASTING) * period
    ends, steps = steps, np.where(steps <= anyway, 0.0, steps)
    groups: dict[tuple[float, bool], list[int]] = {}
    for i, point in enumerate(points):
        lasts = float(steps[min(np.searchsorted(ends, settling(point)), steps.size - 1)])
        groups.setdefault((lasts, is_dithered(point, rig)), []).append(i)
    return sorted(groups.items())
