"""The coil of one magnet as the self-sensing estimators see it."""

import numpy as np

MU_0 = 4e-7 * np.pi


def coil_inductance(gap: np.ndarray | float, turns: float, pole_area: float) -> np.ndarray | float:
    """Inductance (H) of a coil whose flux crosses two air gaps of length gap (m): mu_0 N^2 A_g / (2 g), D eq 6.11
    with ideal iron. Shape of gap. At 0.35 mm, 90 turns and 39.27 mm2 it is the measured 0.57 mH."""
    return MU_0 * turns**2 * pole_area / (2 * gap)
