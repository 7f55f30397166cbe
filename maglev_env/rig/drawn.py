"""Rigs drawn around a nominal one, by factors of its parameters."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from maglev_env.rig.rig import Rig, axis_rig, with_parameters


def tolerance_factors(rig: Rig, rng: np.random.Generator) -> dict[str, float]:
    """Random log-normal factors by parameter; the rig's [tolerance] is the standard deviation of the logarithm."""
    return {name: float(np.exp(rng.normal(0.0, sigma))) for name, sigma in rig.tolerance.items()}


def scaled_rig(rig: Rig, factors: Mapping[str, float]) -> Rig:
    """The rig with parameters multiplied by factors, also those of single axes; parameters that are None stay None.

    What hangs below a single magnet hangs at the gap whatever it weighs: a stated bias current that no longer carries
    the weight gives way to the one that does.
    """
    changed = {name: getattr(rig, name) * factor for name, factor in factors.items() if getattr(rig, name) is not None}
    try:
        scaled = with_parameters(rig, changed)
    except ValueError:
        if not rig.bias_current or "pair" in rig.capabilities:
            raise
        scaled = with_parameters(rig, {**changed, "bias_current": 0.0})
    if rig.axes == 2:  # an axis' own parameters vary with the rig's
        own = {
            axis: {n: v * factors[n] if n in factors else v for n, v in values.items()}
            for axis, values in rig.per_axis.items()
        }
        scaled = replace(scaled, per_axis=own)
        axis_rig(scaled, 0)
    return scaled
