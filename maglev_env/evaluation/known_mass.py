"""What an identified rig owes to a mass that is known to its tolerance alone."""

from dataclasses import replace

from maglev_env.evaluation.bands import with_mass_uncertainty, with_relative_uncertainty
from maglev_env.evaluation.identification import Identification


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
