"""Rows of the magnets' force laws in a lane, and their constants (see `maglev_env.loop.magnets.law`)."""

from collections.abc import Callable, Sequence

import numpy as np

from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw
from maglev_lanes.layout import LaneRows, rows_after

# GAP_C, GAP_M: air gaps of the coil's and the magnet's flux, including the reluctance of the permanent magnet where the
# flux passes it; _SQ: their squares. Fluxes are scaled so that a squared field is an acceleration h^2 f / m. OFFSET:
# position of the magnetic centre, m. KNEE: saturation constant of a pair's fields. PER_GAP: one over the distance at
# y = 0 to which exponents apply. EXPONENT: of one magnet's pull, or what another law adds to that of a pair. WEIGHT and
# DECAY (1/m): of one magnet.
GAP, GAP_C, GAP_M, GAP_C_SQ, GAP_M_SQ, FLUX_M, FLUX_C, BIAS, CALIBRATION, OFFSET, KNEE, _SHAPE = rows_after(
    0, "GAP GAP_C GAP_M GAP_C_SQ GAP_M_SQ FLUX_M FLUX_C BIAS CALIBRATION OFFSET KNEE"
)
# BEND: half the sharpness of a pair's knee; SLOWER: exponent by which what is beyond it falls off; WIDENS: exponent of
# the gap by which its square goes.
PER_GAP, EXPONENT, WEIGHT, DECAY, BEND, SLOWER, WIDENS, END = rows_after(
    _SHAPE, "PER_GAP EXPONENT WEIGHT DECAY BEND SLOWER WIDENS"
)


def fill(
    x: LaneRows,
    laws: Sequence[ForceLaw] | Sequence[SingleSidedLaw],
    per_mass: np.ndarray,
    effect: Callable[..., np.ndarray],
) -> None:
    """Write the constants of the force laws of lanes.

    Args:
        x: written.
        laws: of every lane, all of one kind.
        per_mass: step squared over moving mass, s2/kg, (n,).
        effect: gives a parameter of an effect (the first, or by name) in every lane, (n,).
    """

    def law(name: str) -> np.ndarray:
        return np.array([getattr(one, name) for one in laws])

    single = isinstance(laws[0], SingleSidedLaw)
    x[BIAS], x[OFFSET], x[EXPONENT] = law("bias_current"), effect("eccentricity"), law("exponent")
    x[GAP] = law("gap") + law("coil_gap" if single else "shift")
    x[PER_GAP] = 1 / x[GAP]
    x[GAP_M] = law("gap") + law("magnet_gap")
    # All fluxes carry the root of force_scale, which the pull without current must not have.
    balance, driven = law("stiffness_scale") * (1 + effect("negative_stiffness")), law("force_scale")
    x[CALIBRATION], pulled = balance / driven, driven * per_mass
    if single:
        x[FLUX_M] = np.sqrt(law("area") * pulled) * law("magnet_flux")
        # Calibration scales the nominal balance of pull and weight, but not the additional weight of another mass.
        x[WEIGHT] = (balance * law("weight") + law("weight") * effect("mass")) * per_mass
        x[DECAY] = law("decay")
        # The pull on iron is quadratic in the current, so its root is stored, as if it fell off with the square of the
        # distance; that on a magnet is linear.
        at_rest = np.array([one.falloff(one.gap) for one in laws]) * x[GAP] ** 2
        iron, magnet = law("iron_pull") * at_rest * pulled, law("magnet_pull") * pulled
        x[FLUX_C] = np.where(magnet != 0, magnet, np.sqrt(iron))
    else:
        creep = effect("saturation", "creep")
        x[BEND] = effect("saturation", "sharpness") / 2
        x[SLOWER], x[WIDENS] = (1 - creep) / x[BEND], 2 * creep / (1 - creep)
        x[KNEE] = 1 / (4 * effect("saturation") ** 2 * law("area") * pulled) ** 2
        # Sums and differences of the two gaps' fields carry a factor two.
        root = 2 * np.sqrt(law("area") * pulled)
        x[FLUX_M], x[FLUX_C] = root * law("magnet_flux"), root * law("coil_flux")
        x[GAP_C] = law("gap") + law("coil_gap")  # one law serves both flux paths
    x[GAP_C_SQ], x[GAP_M_SQ] = x[GAP_C] ** 2, x[GAP_M] ** 2
