"""Magnetic co-energy of the force laws in closed form; its derivative by the displacement is the force."""

from collections.abc import Callable
from functools import singledispatch

import numpy as np

from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw


@singledispatch
def coenergy(law: ForceLaw, displacement: np.ndarray | float, current: np.ndarray | float) -> np.ndarray | float:
    """Co-energy W of a law; force = +dW/dy at constant current.

    A shrinking gap raises the co-energy, and the force acts in that direction. The weight of the single-sided laws
    enters as -m g y. The calibration is that of the force: with s = gain_scale,
    stiffness_scale W(y, 0) + force_scale [W(y, s i) - W(y, 0)]. Terms that do not depend on the displacement are left
    out. Without calibration d2W/di2 is the sum of the inductances of an electromagnet pair's coils. D's hybrid law
    (area n_b A_g / (2 mu_0)) counts one pole face per magnet, so its W is half the co-energy of the magnetic circuit.

    Args:
        law: the force law.
        displacement: y, m.
        current: control current i, A; broadcasts with displacement.

    Returns:
        W in J, in the common shape of displacement and current.

    Raises:
        ValueError: The law has no co-energy in closed form: a pair with another exponent, or a pull that both decays
            exponentially and has an exponent.
    """
    if law.exponent:
        raise ValueError("coenergy: a pair with another exponent of the gap has none in closed form")
    return _calibrated(_pair, law, displacement, current)


@coenergy.register
def _(law: SingleSidedLaw, displacement: np.ndarray | float, current: np.ndarray | float) -> np.ndarray | float:
    return _calibrated(_single, law, displacement, current)


def _calibrated(
    raw: Callable[..., np.ndarray | float],
    law: ForceLaw | SingleSidedLaw,
    displacement: np.ndarray | float,
    current: np.ndarray | float,
) -> np.ndarray | float:
    resting = raw(law, displacement, 0.0)
    driven = raw(law, displacement, law.gain_scale * current) - resting
    return law.stiffness_scale * resting + law.force_scale * driven


def _pair(law: ForceLaw, y: np.ndarray | float, i: np.ndarray | float) -> np.ndarray | float:
    total = 0.0
    for gap, current in ((law.gap - y, law.bias_current + i), (law.gap + y, law.bias_current - i)):
        # Integrals of B^2 over larger gaps: the magnet's field squared, the coil's squared, and twice their product.
        coil = law.coil_flux * current
        total = total + law.magnet_flux**2 / (gap + law.magnet_gap) + coil**2 / (gap + law.coil_gap)
        apart = law.magnet_gap - law.coil_gap
        shared = np.log1p(apart / (gap + law.coil_gap)) / apart if apart else 1 / (gap + law.coil_gap)
        total = total + 2 * law.magnet_flux * coil * shared
    return law.area * total


def _single(law: SingleSidedLaw, y: np.ndarray | float, i: np.ndarray | float) -> np.ndarray | float:
    gap, current = law.gap - y, law.bias_current + i
    attraction = law.area * law.magnet_flux**2 / (gap + law.magnet_gap)
    return (law.iron_pull * current + law.magnet_pull) * current * _reach(law, gap) + attraction - law.weight * y


def _reach(law: SingleSidedLaw, gap: np.ndarray | float) -> np.ndarray | float:
    """Integral of the coil's falloff from a gap to a fixed one."""
    if law.decay:
        if law.exponent:
            raise ValueError("coenergy: a pull with both an exponential decay and an exponent has none in closed form")
        return np.exp(-law.decay * gap) / law.decay
    x, resting, n = gap + law.coil_gap, law.gap + law.coil_gap, law.exponent - 1
    if n == 1:
        return 1 / x  # up to a constant: the inductance of the coil, for electromagnets
    # A logarithm for n = 0; expm1 keeps the integral accurate near it.
    nearer = -np.log(x / resting)
    return resting**-n * (np.expm1(n * nearer) / n if n else nearer)
