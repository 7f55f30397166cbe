"""Rigs drawn around a nominal one, by factors of its parameters."""

from collections.abc import Mapping
from dataclasses import replace
from math import inf

import numpy as np

from maglev_env.loop.axes import AXES
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import Rig, axis_rig, with_parameters

TANGENT = ("actuator_gain", "negative_stiffness")


def tangent(rig: Rig) -> dict[str, float]:
    """The values of TANGENT (N/A and N/m) of a rig with magnets, stated or given by its geometry."""
    return dict(zip(TANGENT, linearise(force_law(rig)), strict=True))


def tolerance_factors(rig: Rig, rng: np.random.Generator) -> dict[str, float]:
    """Random log-normal factors by parameter; the rig's [tolerance] is the standard deviation of the logarithm."""
    return {name: float(np.exp(rng.normal(0.0, sigma))) for name, sigma in rig.tolerance.items()}


def scaled_rig(rig: Rig, factors: Mapping[str, float]) -> Rig:
    """The rig with parameters multiplied by factors, also those of single axes; parameters that are None stay None.

    What a magnet's geometry gives in place of a stated actuator_gain or negative_stiffness is multiplied, too. The
    clearance stays within the gap. What hangs below a single magnet hangs at the gap whatever it weighs: a stated bias
    current that no longer carries the weight gives way to the one that does.

    Raises:
        ValueError: A parameter is then outside its physical range; the message names it.
    """
    changed = {name: getattr(rig, name) * factor for name, factor in factors.items() if getattr(rig, name) is not None}
    own = {
        axis: {n: v * factors[n] if n in factors else v for n, v in values.items()}
        for axis, values in rig.per_axis.items()
    }
    follows = rig.clearance == rig.gap and "clearance" not in changed
    room = min([changed.get("gap", rig.gap), *(values.get("gap", inf) for values in own.values())])
    if not follows and changed.get("clearance", rig.clearance) > room:
        changed["clearance"] = room
    # An axis' own parameters are checked with the others when all are scaled.
    alike = replace(rig, per_axis={}) if own else rig
    try:
        scaled = with_parameters(alike, changed)
    except ValueError:
        if not rig.bias_current or "pair" in rig.capabilities:
            raise
        scaled = with_parameters(alike, {**changed, "bias_current": 0.0})
    if own:
        scaled = replace(scaled, per_axis=own)
    return _with_tangent(scaled, {name: factors[name] for name in TANGENT if name in factors})


def _with_tangent(rig: Rig, factors: Mapping[str, float]) -> Rig:
    """The rig with factors of TANGENT where its geometry gives the value."""
    if not rig.controlled or not factors:
        return rig

    def given(one: Rig) -> dict[str, float]:
        free = {name: value for name, value in tangent(one).items() if name in factors and getattr(one, name) is None}
        return {n: v * factors[n] for n, v in free.items() if n == "actuator_gain" or v < 0}  # may be stated at all

    if not rig.per_axis:
        found = given(rig)
        return with_parameters(rig, found) if found else rig
    own = {name: {**rig.per_axis.get(name, {}), **given(axis_rig(rig, axis))} for axis, name in enumerate(AXES)}
    return replace(rig, per_axis={name: values for name, values in own.items() if values})
