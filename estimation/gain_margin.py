"""The factors by which a loop's gain may rise or fall, from its measured sensitivity."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ALONG = 0.577  # largest |Im L / Re L| at the lowest line, 30 degrees, with which it lies along the real axis


def gain_factors(sensitivity: NDArray[np.complex128], margins: Mapping[str, Array]) -> tuple[Array, Array]:
    """Factors (...) > 1 by which the gain may rise, and by which it may fall; nan where the lines hold none.

    A plant that is unstable at rest, as that of a magnet, needs a loop gain beyond -1 at rest: the gain may fall by
    |L(0)| at most. There L touches the real axis without crossing it, and no line is there, so that the lowest line
    tells: L lies beside the real axis, and its real part is |L(0)| less what a leaking integral adds below it.

    Args:
        sensitivity: (..., n), the lowest line first.
        margins: By `stability_margins.margin_arrays`.
    """
    at_rest, along = lowest_gain(sensitivity)
    return margins["gain_margin_high"], np.fmin(1 / margins["gain_margin_low"], np.where(along, at_rest, np.nan))


def lowest_gain(sensitivity: NDArray[np.complex128]) -> tuple[Array, NDArray[np.bool_]]:
    """-Re L (...) at the lowest line, and whether that lies along the real axis beyond -1."""
    gain = 1 / sensitivity[..., 0] - 1
    return -gain.real, (gain.real < -1) & (np.abs(gain.imag) < ALONG * np.abs(gain.real))
