"""What an identified rig owes to a mass that is known to its tolerance alone."""

from dataclasses import replace

import numpy as np

from estimation.normal import NORMAL_95
from maglev_env.evaluation.bands import with_mass_uncertainty, with_relative_uncertainty
from maglev_env.evaluation.identification import Identification
from maglev_env.evaluation.identification_planar import PlanarIdentification


def within_tolerance_of_mass(found: Identification, tolerance: float) -> Identification:
    """The identification with its intervals widened by a relative standard error of the mass that was given.

    Of a measured force, k + m w^2 is what the lines tell, so an error of the mass is one of w^2 times as much of the
    stiffness. Where the mass sets the scale of the force, gain, stiffness and damping grow with it.

    Args:
        found: By a given mass; one that was fitted has its own error already.
        tolerance: Relative; 0 says that the mass is exact.
    """
    if not tolerance or found.modal is not None:
        return found
    actuator = found.actuator
    if actuator is None:
        return replace(found, bands=tuple(with_mass_uncertainty(b, tolerance * found.mass) for b in found.bands))
    sizes = (actuator.gain, actuator.stiffness, actuator.damping)
    return replace(
        found,
        bands=tuple(with_relative_uncertainty(b, tolerance) for b in found.bands),
        actuator=actuator.with_errors(*(tolerance * abs(size) for size in sizes)),
    )


def planar_within_tolerance_of_mass(
    found: PlanarIdentification, tolerances: tuple[float, float]
) -> PlanarIdentification:
    """The eight coefficients with the intervals of the direct stiffnesses widened by relative errors of both masses.

    Args:
        found: By given masses.
        tolerances: Relative, of x and y; 0 says that a mass is exact.
    """
    square = (np.pi * found.bands.sum(axis=1)) ** 2
    more = np.zeros_like(found.estimate.stiffness)
    for axis, (mass, tolerance) in enumerate(zip(found.masses, tolerances, strict=True)):
        more[..., axis, axis] = tolerance * mass * square
    value, half = found.estimate.stiffness, NORMAL_95 * more
    estimate = replace(
        found.estimate,
        stiffness_se=np.hypot(found.estimate.stiffness_se, more),
        stiffness_low=value - np.hypot(value - found.estimate.stiffness_low, half),
        stiffness_high=value + np.hypot(found.estimate.stiffness_high - value, half),
    )
    return replace(found, estimate=estimate)
