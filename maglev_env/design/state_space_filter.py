"""A controller in state space as the filter that a rig's controller runs."""

import numpy as np

from maglev_env.loop.gains import controller_response
from maglev_env.loop.linear_controller import LinearController

LOST = 1e-2  # relative error of the response by rounding, from which on a filter's coefficients say something else
LOWEST, TOP, POINTS = 1e-4, 0.499, 300  # shares of the control rate between which that is looked at


def state_space_filter(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: float, dt: float) -> LinearController:
    """The filter with the response d + c (z - a)^-1 b from the negative reading (m) to the command (A).

    Args:
        a: (n, n).
        b: (n,).
        c: (n,).
        d: A/m.
        dt: Control step, s.

    Raises:
        ValueError: Rounded coefficients of such a filter have another response, as those of poles that crowd at z = 1.
    """
    z = np.exp(2j * np.pi * np.geomspace(LOWEST, TOP, POINTS))
    wanted = d + np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a, b[:, None])[..., 0] @ c
    poles = np.linalg.eigvals(a)
    # By a least-squares fit of the numerator: differences of two polynomials would lose the digits of a small one.
    powers = z[:, None] ** -np.arange(len(a) + 1)
    denominator = np.real(np.poly(poles))
    below = powers @ denominator
    if not below.all():
        raise ValueError(f"a filter of order {len(a)} at {1 / dt:g} Hz loses its digits: it divides by zero")
    made = powers / below[:, None] / wanted[:, None]
    rows = np.concatenate([made.real, made.imag])
    scale = np.linalg.norm(rows, axis=0)
    numerator = np.linalg.lstsq(rows / scale, np.repeat([1.0, 0.0], POINTS), rcond=None)[0] / scale
    found = LinearController(tuple(map(float, numerator)), tuple(map(float, denominator)))
    error = float(np.abs(controller_response(found, z, dt) / wanted - 1).max())
    if not error < LOST:
        raise ValueError(
            f"a filter of order {len(a)} at {1 / dt:g} Hz loses its digits: its response is wrong by {error:.1%}"
        )
    return found
