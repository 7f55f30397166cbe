"""Rigs drawn around a nominal one, by factors of its parameters."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from maglev_env.rig.rig import Rig, axis_rig, with_parameters


def tolerance_factors(rig: Rig, rng: np.random.Generator) -> dict[str, float]:
    """Random log-normal factors by parameter; the rig's [tolerance] is the standard deviation of the logarithm."""
    return {name: float(np.exp(rng.normal(0.0, sigma))) for name, sigma in rig.tolerance.items()}


def scaled_rig(rig: Rig, factors: Mapping[str, float]) -> Rig:
    """The rig with parameters multiplied by factors, also those of single axes; parameters that are None stay None."""
    changed = {name: getattr(rig, name) * factor for name, factor in factors.items() if getattr(rig, name) is not None}
    scaled = with_parameters(rig, changed)
    if rig.axes == 2:  # an axis' own parameters vary with the rig's
        own = {axis: {n: v * factors.get(n, 1.0) for n, v in values.items()} for axis, values in rig.per_axis.items()}
        scaled = replace(scaled, per_axis=own)
        axis_rig(scaled, 0)
    return scaled
