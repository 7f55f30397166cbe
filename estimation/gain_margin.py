"""The factors by which a loop's gain may rise or fall, from its measured sensitivity."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

ALONG = 0.577  # largest |Im L / Re L| at the lowest line, 30 degrees, with which it lies along the real axis
LOWEST = 4  # lines from which L is extrapolated to rest


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

    Of a mass m on a stiffness k under a gain with a derivative, (1 + b s) / L = a + c s^2 with a real b, and real a and
    c in proportion to k and m: their least squares at the lowest lines give a = 1 / L(0). What a leaking integral adds
    below the lines is left out, which is cautious.

    Args:
        frequency: As in `gain_factors`.
        sensitivity: Likewise.
        variance: Of its noise, E|noise|^2, (..., n).
    """
    s, gain = 2j * np.pi * frequency[:LOWEST], 1 / sensitivity[..., :LOWEST] - 1
    scale = np.abs(s[-1])
    columns = np.stack([*np.broadcast_arrays(1.0, (s / scale) ** 2, -s / scale / gain)], axis=-1)
    columns = np.concatenate([columns.real, columns.imag], axis=-2)
    share = np.linalg.pinv(columns)
    a, _, b = np.moveaxis(
        (share @ np.concatenate([(1 / gain).real, (1 / gain).imag], axis=-1)[..., None])[..., 0], -1, 0
    )
    beyond = (gain[..., 0].real < -1) & (np.abs(gain[..., 0].imag) < ALONG * np.abs(gain[..., 0].real))
    value = np.where(beyond & (a > -1) & (a < 0), -1 / np.where(a < 0, a, -1.0), np.nan)
    if variance is None:
        return value, np.full(value.shape, np.nan)
    # The noise of 1 / L, of its real and of its imaginary part, as (1 + b s) / L has it.
    noise = variance[..., :LOWEST] / 2 / np.abs(sensitivity[..., :LOWEST] * gain) ** 4
    noise = noise * np.abs(1 + b[..., None] * s / scale) ** 2
    return value, np.sqrt((share[..., 0, :] ** 2 * np.concatenate([noise, noise], axis=-1)).sum(axis=-1)) * value**2
