"""Standard errors of stability margins to first order in the noise of the sensitivity, for many loops at a time.

`stability_margins.margins` gives bootstrap intervals of one loop; these cost nothing and hold where the noise is small.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimation.stability_margins import loop_gain

Array = NDArray[np.float64]


def margin_errors(
    frequency: Array, sensitivity: NDArray[np.complex128], variance: Array, margins: Mapping[str, Array]
) -> dict[str, Array]:
    """Standard errors (n,) of the margins of n loops, by name; nan where a margin is missing.

    Noise dL moves a crossing of L along its tangent t. At the gain crossover the phase then changes by
    Im(conj(L) dL) - r Re(conj(L) dL) with r = Im(conj(L) t) / Re(conj(L) t), and at the phase crossover the real part
    changes by Re(dL) - q Im(dL) with q = Re(t) / Im(t). The values are those of the nearest line.

    Args:
        frequency: Increasing frequencies (f,), Hz.
        sensitivity: Complex sensitivities (n, f).
        variance: Their variances E|noise|^2, (n, f), circular.
        margins: Values of `stability_margins.margin_arrays`.
    """
    gain = loop_gain(sensitivity)
    tangent = np.gradient(gain, np.log(frequency), axis=-1)
    of_gain = variance / np.abs(sensitivity) ** 4 / 2  # of the real and of the imaginary part of L

    def nearest(at: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        distance = np.abs(np.log(frequency / np.where(np.isnan(at), frequency[0], at)[:, None]))
        return np.arange(len(at)), distance.argmin(axis=1)

    found: dict[str, Array] = {}
    for name in ("peak_sensitivity", "disk_margin"):
        here = nearest(margins[name.replace("_sensitivity", "") + "_frequency"])
        se = np.sqrt(variance[here] / 2)
        found[name] = se * margins[name] ** 2 if name == "disk_margin" else se
    here = nearest(margins["phase_margin_frequency"])
    turned = np.conj(gain[here]) * tangent[here]
    lever = np.hypot(1.0, turned.imag / turned.real)
    found["phase_margin"] = np.degrees(np.sqrt(of_gain[here]) / np.abs(gain[here]) * lever)
    for name in ("gain_margin_high", "gain_margin_low"):
        here = nearest(margins[f"{name}_frequency"])
        lever = np.hypot(1.0, tangent[here].real / tangent[here].imag)
        found[name] = np.sqrt(of_gain[here]) * lever * margins[name] ** 2
    return {name: np.where(np.isnan(margins[name]), np.nan, se) for name, se in found.items()}
