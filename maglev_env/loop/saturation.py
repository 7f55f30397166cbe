"""A knee at the current that pulls, or at the command: what flows while the weight hangs still, and the slope there.

A single magnet carries the weight with a current of its own, so the whole current saturates: S(I) = I / (1 +
|I / K|^n)^(1 / n) with I = rest + i. Its force law, its weight and therefore the current that must pull at rest,
I_0, stay what they are without the knee; the coil carries S^-1(I_0) instead, and the command asks for what makes the
coil carry that. All signals of the loop are deviations from these. Of a pair the control current alone saturates: I_0
is zero, and so are the others. Where the flux of a single magnet saturates, K goes with the distance: at rest it is K.
"""

import numpy as np

from maglev_env.loop.magnets.law import SingleSidedLaw
from maglev_env.loop.system import Values


def at_rest(values: Values) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Currents at rest, A, (n,) each: what pulls, what the coil carries, and what the command asks for."""
    sharpness = values.effect("saturation", "sharpness")
    pulls = np.array([law.rest_current if law else 0.0 for law in values.laws])
    carries = _before(pulls, values.effect("saturation", "current"), sharpness)
    return pulls, carries, _before(carries, values.effect("saturation", "command"), sharpness)


def slopes(values: Values) -> tuple[np.ndarray, np.ndarray]:
    """Change at rest of the current that pulls per ampere in the coil, and of the latter's source per ampere asked for.

    Both (n,), 1 without a knee.
    """
    sharpness = values.effect("saturation", "sharpness")
    pulls, carries, _ = at_rest(values)
    return (
        _slope(pulls, values.effect("saturation", "current"), sharpness),
        _slope(carries, values.effect("saturation", "command"), sharpness),
    )


def _before(passed: np.ndarray, knee: np.ndarray, sharpness: np.ndarray) -> np.ndarray:
    """The current of which a knee passes this much.

    Where it never passes so much, no current carries the weight: the rotor falls.
    """
    taken = _taken(passed, knee, sharpness)
    return np.where(taken < 1, passed / np.where(taken < 1, 1 - taken, 1.0) ** (1 / sharpness), passed)


def _slope(passed: np.ndarray, knee: np.ndarray, sharpness: np.ndarray) -> np.ndarray:
    """dS/dI where S is `passed`: (1 - |S / K|^n)^(1 + 1 / n)."""
    return np.maximum(1 - _taken(passed, knee, sharpness), 0.0) ** (1 + 1 / sharpness)


def _taken(passed: np.ndarray, knee: np.ndarray, sharpness: np.ndarray) -> np.ndarray:
    return np.minimum(abs(passed) / knee, 2.0) ** sharpness


def slope_by_nearness(values: Values) -> np.ndarray:
    """Change at rest of the current that pulls per displacement, A/m, (n,): 0 where the knee is the same everywhere.

    A knee of the flux is at K (s(gap) / s(x))^(1/2), where the pull goes with s(x). With T = |S / K|^n at rest,
    dS/dy = -S T (d ln s / dy) / 2.
    """
    pulls, _, _ = at_rest(values)
    taken = _taken(pulls, values.effect("saturation", "current"), values.effect("saturation", "sharpness"))
    steep = np.array([law.steepness if isinstance(law, SingleSidedLaw) else 0.0 for law in values.laws])
    return -0.5 * values.effect("saturation", "distance_share") * pulls * np.minimum(taken, 1.0) * steep
