"""What an identified rig owes to a mass and to channels that are known to their tolerances alone."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from estimation.normal import NORMAL_95
from maglev_env.evaluation.bands import (
    with_gain_uncertainty,
    with_mass_uncertainty,
    with_relative_uncertainty,
    with_timing_uncertainty,
)
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
    actuator, gain = found.actuator, found.gain
    # The gain over frequency has its scale, and that of the stiffness that it stands on, from the mass in both cases.
    gain = gain and gain.with_errors(tolerance, 0.0, tolerance * abs(gain.stiffness))
    if actuator is None:
        bands = tuple(with_mass_uncertainty(b, tolerance * found.mass) for b in found.bands)
        return replace(found, bands=bands, gain=gain)
    sizes = (actuator.gain, actuator.stiffness, actuator.damping)
    return replace(
        found,
        bands=tuple(with_relative_uncertainty(b, tolerance) for b in found.bands),
        actuator=actuator.with_errors(*(tolerance * abs(size) for size in sizes)),
        gain=gain,
    )


def within_tolerance_of_channels(found: Identification, scales: Mapping[str, float], time: float) -> Identification:
    """The identification with its intervals widened by the standard errors of its channels' scales and times.

    Stiffness and damping through the current have their scale from the mass, and only the gain has that of the
    channels. Of a measured force the scales of both channels are those of k - m w^2.

    Args:
        found: By a given mass; one that was fitted is left as it is.
        scales: Relative, of "displacement", "current" and "force".
        time: Between the displacement and what drives it, s.
    """
    if found.modal is not None:
        return found
    of_gain, of_force = (float(np.hypot(scales["displacement"], scales[by])) for by in ("current", "force"))
    bands = tuple(with_timing_uncertainty(b, time, found.mass) for b in found.bands)
    gain, actuator = found.gain and found.gain.with_errors(of_gain, time, 0.0), found.actuator
    if actuator is None:
        bands = tuple(with_gain_uncertainty(b, of_force, found.mass) for b in bands)
    else:
        dynamic = actuator.stiffness - found.mass * (2 * np.pi * found.statistics.frequency) ** 2
        actuator = actuator.with_errors(of_gain * abs(actuator.gain), 0.0, time * float(np.median(abs(dynamic))))
    return replace(found, bands=bands, actuator=actuator, gain=gain)


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
