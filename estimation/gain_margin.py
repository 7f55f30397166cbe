"""The factors by which a loop's gain may rise or fall, from its measured sensitivity."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

ALONG = 0.577  # largest |Im L / Re L| at the lowest line, 30 degrees, with which it lies along the real axis
LOWEST = 3  # lines from which L is extrapolated to rest


def gain_factors(frequency: Array, sensitivity: Complex, margins: Mapping[str, Array]) -> tuple[Array, Array]:
    """Factors (...) > 1 by which the gain may rise, and by which it may fall; nan where the lines hold none.

    A plant that is unstable at rest, as that of a magnet, needs a loop gain beyond -1 at rest: the gain may fall by
    |L(0)| at most. There L touches the real axis without crossing it, and no line is there (see `at_rest`).

    Args:
        frequency: Increasing, (n,), Hz.
        sensitivity: (..., n).
        margins: By `stability_margins.margin_arrays`.
    """
    return margins["gain_margin_high"], np.fmin(1 / margins["gain_margin_low"], at_rest(frequency, sensitivity)[0])


def at_rest(frequency: Array, sensitivity: Complex, variance: Array | None = None) -> tuple[Array, Array]:
    """|L(0)| (...) of loops that need it above 1, nan of others, and its standard error, nan without a variance.

    Under a gain that hardly varies, 1 / L of a mass on a negative stiffness is linear in the square of the frequency:
    the lowest lines are extrapolated by that. What a leaking integral adds below them is left out, which is cautious.

    Args:
        frequency: As in `gain_factors`.
        sensitivity: Likewise.
        variance: Of its noise, E|noise|^2, (..., n).
    """
    square, gain = frequency[:LOWEST] ** 2, 1 / sensitivity[..., :LOWEST] - 1
    share = np.linalg.pinv(np.vander(square / square[-1], 2))[1]  # of each line in the intercept
    rest = (1 / gain).real @ share
    beyond = (gain[..., 0].real < -1) & (np.abs(gain[..., 0].imag) < ALONG * np.abs(gain[..., 0].real))
    value = np.where(beyond & (rest > -1) & (rest < 0), -1 / np.where(rest < 0, rest, -1.0), np.nan)
    if variance is None:
        return value, np.full(value.shape, np.nan)
    of_inverse = variance[..., :LOWEST] / 2 / np.abs(sensitivity[..., :LOWEST] * gain) ** 4  # of the real part of 1 / L
    return value, np.sqrt(of_inverse @ share**2) * value**2
