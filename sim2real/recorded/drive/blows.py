"""A hammer's force without the noise of its transducer between the blows, where nothing touches the rotor."""

import numpy as np
from scipy.ndimage import binary_dilation, label
from scipy.stats import median_abs_deviation

BLOW = 6.0  # standard deviations of the noise beyond which a force is one of a blow
LOUD = 10.0  # times as far, at least, the blows reach
FEW = 0.1  # share of the samples, at most, that are of blows
STATED = 2.0  # times the stated noise, at most, that is between them


def between_blows(force: np.ndarray, noise: float) -> tuple[np.ndarray, str | None]:
    """Force with a constant between the blows, and what is said of it; unchanged where these are no blows.

    A simulation is driven by the recorded force. The noise of its transducer would move the simulated rotor where the
    real one stands still, which a small friction that is not there takes away.

    Args:
        force: (axes, samples), N.
        noise: Stated standard deviation of the force's noise, N.
    """
    found, loudest = force.copy(), 0.0
    for axis, own in enumerate(force):
        rest = np.median(own)
        sd = float(median_abs_deviation(own, scale="normal"))
        struck = abs(own - rest) > BLOW * sd
        _, blows = label(struck)
        if not 0 < sd < STATED * noise or not blows or abs(own - rest).max() < LOUD * BLOW * sd:
            continue
        # The foot of a blow, and what the filter of its log makes of it, is no longer than the blow.
        near = binary_dilation(struck, iterations=1 + int(struck.sum() // blows))
        if near.mean() > FEW:
            continue
        found[axis, ~near] = own[~near].mean()
        loudest = max(loudest, sd)
    if not loudest:
        return force, None
    return found, (
        f"force: between the blows it is noise of {loudest:.2g} N, as stated; it is taken for constant there, because "
        "nothing touches the rotor"
    )
