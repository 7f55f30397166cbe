"""A knee at the current that pulls, or at the command: what flows while the weight hangs still, and the slope there.

A single magnet carries the weight with a current of its own, so the whole current saturates: S(I) = I / (1 +
|I / K|^n)^(1 / n) with I = rest + i. Its force law, its weight and therefore the current that must pull at rest,
I_0, stay what they are without the knee; the coil carries S^-1(I_0) instead, and the command asks for what makes the
coil carry that. All signals of the loop are deviations from these. Of a pair the control current alone saturates: I_0
is zero, and so are the others. Where the flux of a single magnet saturates, K goes with the distance: at rest it is K.
Where the iron creeps, the exponent of the knee is (1 - c) / n in place of 1 / n.
"""

from math import log

import numpy as np
from scipy.special import expit

from maglev_env.loop.magnets.law import SingleSidedLaw
from maglev_env.loop.system import Values

MOST, NEARLY = 1e3, 1 - 1e-9  # knees: a current beyond which none passes more; a share of it that is all of it
STEPS = 60  # of Newton's, towards what makes a knee that creeps pass so much


def at_rest(values: Values) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Currents at rest, A, (n,) each: what pulls, what the coil carries, and what the command asks for."""
    sharpness, creep = _form(values)
    pulls = np.array([law.rest_current if law else 0.0 for law in values.laws])
    carries = _before(pulls, values.effect("saturation", "current"), sharpness, creep)
    return pulls, carries, _before(carries, values.effect("saturation", "command"), sharpness, creep)


def slopes(values: Values) -> tuple[np.ndarray, np.ndarray]:
    """Change at rest of the current that pulls per ampere in the coil, and of the latter's source per ampere asked for.

    Both (n,), 1 without a knee.
    """
    sharpness, creep = _form(values)
    _, carries, asks = at_rest(values)
    return (
        _slope(carries, values.effect("saturation", "current"), sharpness, creep),
        _slope(asks, values.effect("saturation", "command"), sharpness, creep),
    )


def fall(values: Values) -> np.ndarray:
    """Exponent of the knee, (1 - creep) / sharpness, (n,)."""
    sharpness, creep = _form(values)
    return (1 - creep) / sharpness


def slope_by_nearness(values: Values) -> np.ndarray:
    """Change at rest of the current that pulls per displacement, A/m, (n,): 0 where the knee is the same everywhere.

    A knee of the flux is at K (s(gap) / s(x))^(1/2), where the pull goes with s(x). With T = r^n / (1 + r^n), where the
    coil carries r K at rest, dS/dy = -S (1 - c) T (d ln s / dy) / 2.
    """
    sharpness, creep = _form(values)
    pulls, carries, _ = at_rest(values)
    taken = (1 - creep) * _taken(carries, values.effect("saturation", "current"), sharpness)
    steep = np.array([law.steepness if isinstance(law, SingleSidedLaw) else 0.0 for law in values.laws])
    return -0.5 * values.effect("saturation", "distance_share") * pulls * taken * steep


def _form(values: Values) -> tuple[np.ndarray, np.ndarray]:
    return values.effect("saturation", "sharpness"), values.effect("saturation", "creep")


def _before(passed: np.ndarray, knee: np.ndarray, sharpness: np.ndarray, creep: np.ndarray) -> np.ndarray:
    """The current of which a knee passes this much, at most MOST knees: with less no current carries the weight, and
    the rotor falls."""
    there = np.isfinite(knee) & (passed != 0)
    if not there.any():  # as on most rigs, whose lanes are built again for every step of a fit
        return passed
    size = np.where(there, knee, 1.0)
    wanted = np.log(np.where(there, abs(passed) / size, 0.5))
    at = np.minimum(wanted, 0.0)  # ln of the current in knees; from below, where Newton's steps never go too far
    for _ in range(STEPS):
        short = wanted - at + (1 - creep) * np.logaddexp(0.0, sharpness * at) / sharpness
        slope = 1 - (1 - creep) * expit(sharpness * at)
        at = np.minimum(at + short / np.maximum(slope, 1e-300), log(MOST))
    return np.where(there, np.sign(passed) * np.exp(at) * size, passed)


def _slope(current: np.ndarray, knee: np.ndarray, sharpness: np.ndarray, creep: np.ndarray) -> np.ndarray:
    """dS/dI of the knee at a current: (1 - (1 - c) T) / (1 + r^n)^((1 - c) / n); 0 where none is enough."""
    kept = np.exp(-(1 - creep) / sharpness * np.logaddexp(0.0, sharpness * _logarithm(current, knee)))
    slope = (1 - (1 - creep) * _taken(current, knee, sharpness)) * kept
    return np.where(abs(current) < NEARLY * MOST * knee, slope, 0.0)


def _taken(current: np.ndarray, knee: np.ndarray, sharpness: np.ndarray) -> np.ndarray:
    """T = r^n / (1 + r^n) at a current of r knees."""
    return expit(sharpness * _logarithm(current, knee))


def _logarithm(current: np.ndarray, knee: np.ndarray) -> np.ndarray:
    return np.log(np.maximum(abs(current) / knee, 1e-300))
