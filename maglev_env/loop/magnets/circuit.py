"""Magnetic circuits: from a magnet's geometry to the constants of its force law."""

from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw
from maglev_env.loop.magnets.magnet import Magnet
from selfsense.coil import MU_0


def magnet_circuit(m: Magnet) -> tuple[float, float]:
    """A permanent magnet's flux density times air gap (T m), and its reluctance as the length of an air gap (m).

    The reluctance is that of the equivalent air gap at one pole face.
    """
    mu_m = m.recoil_permeability * MU_0
    reluctance_gap = 0.5 * MU_0 * m.magnet_length * m.pole_area / (mu_m * m.magnet_area)
    return 0.5 * MU_0 * m.remanence * m.magnet_length / mu_m, reluctance_gap


def magnet_attraction(m: Magnet) -> float:
    """Force (N) with which a permanent magnet attracts the iron of its coil at y = 0."""
    magnet_flux, magnet_gap = magnet_circuit(m)
    return m.pole_area / (2 * MU_0) * (magnet_flux / (m.gap + magnet_gap)) ** 2


def pair_law(m: Magnet, area: float, magnet_flux: float, magnet_gap: float, coil_gap: float) -> ForceLaw:
    """The uncalibrated law of two opposed magnets; the arguments are fields of `ForceLaw`."""
    coil_flux = 0.5 * MU_0 * m.turns
    return ForceLaw(area, m.gap, magnet_flux, magnet_gap, coil_flux, coil_gap, m.bias_current, 1.0, 1.0)


def single_sided_law(
    m: Magnet,
    bias: float,
    exponent: float,
    iron_pull: float = 0.0,
    magnet_pull: float = 0.0,
    coil_gap: float = 0.0,
    decay: float = 0.0,
) -> SingleSidedLaw:
    """The uncalibrated law of one magnet above the rotor, with bias in A; the others are fields of `SingleSidedLaw`."""
    area, weight = m.pole_area / (2 * MU_0), m.mass * m.gravity
    flux, magnet_gap = magnet_circuit(m)
    return SingleSidedLaw(
        m.gap, iron_pull, magnet_pull, exponent, area, flux, magnet_gap, weight, bias, 1.0, 1.0, coil_gap, decay
    )  # fmt: skip
