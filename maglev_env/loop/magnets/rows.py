"""Rows of the magnets' force laws in a lane, and their constants (see `maglev_env.loop.magnets.law`)."""

from collections.abc import Callable, Sequence

import numpy as np

from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw
from maglev_lanes.layout import LaneRows, rows_after

# GAP_C, GAP_M: air gaps of the coil's and the magnet's flux, including the reluctance of the permanent magnet where the
# flux passes it; _SQ: their squares. Fluxes are scaled so that a squared field is an acceleration h^2 f / m. OFFSET:
# position of the magnetic centre, m. KNEE: saturation constant of a pair's fields. WEIGHT, EXPONENT: of one magnet.
GAP, GAP_C, GAP_M, GAP_C_SQ, GAP_M_SQ, FLUX_M, FLUX_C, BIAS, CALIBRATION, OFFSET, KNEE, _SINGLE = rows_after(
    0, "GAP GAP_C GAP_M GAP_C_SQ GAP_M_SQ FLUX_M FLUX_C BIAS CALIBRATION OFFSET KNEE"
)
WEIGHT, EXPONENT, END = rows_after(_SINGLE, "WEIGHT EXPONENT")


def fill(
    x: LaneRows,
    laws: Sequence[ForceLaw] | Sequence[SingleSidedLaw],
    per_mass: np.ndarray,
    effect: Callable[[str], np.ndarray],
) -> None:
    """Write the constants of the force laws of lanes.

    Args:
        x: written.
        laws: of every lane, all of one kind.
        per_mass: step squared over moving mass, s2/kg, (n,).
        effect: gives the first parameter of an effect in every lane, (n,).
    """

    def law(name: str) -> np.ndarray:
        return np.array([getattr(one, name) for one in laws])

    x[BIAS], x[GAP], x[OFFSET] = law("bias_current"), law("gap"), effect("eccentricity")
    x[GAP_M] = law("gap") + law("magnet_gap")
    x[CALIBRATION] = law("stiffness_scale") * (1 + effect("negative_stiffness"))
    if isinstance(laws[0], SingleSidedLaw):
        x[FLUX_M] = np.sqrt(law("area") * per_mass) * law("magnet_flux")
        # Calibration scales the nominal balance of pull and weight, but not the additional weight of another mass.
        x[WEIGHT] = (x[CALIBRATION] * law("weight") + law("weight") * effect("mass")) * per_mass
        x[EXPONENT] = law("exponent")
        # The pull on iron is quadratic in the current, so its root is stored; that on a magnet is linear.
        iron, magnet = law("iron_pull") * per_mass, law("magnet_pull") * per_mass
        x[FLUX_C] = np.where(magnet != 0, magnet, np.sqrt(iron))
    else:
        x[KNEE] = 1 / (4 * effect("saturation") ** 2 * law("area") * per_mass) ** 2
        # Sums and differences of the two gaps' fields carry a factor two.
        root = 2 * np.sqrt(law("area") * per_mass)
        x[FLUX_M], x[FLUX_C] = root * law("magnet_flux"), root * law("coil_flux")
        x[GAP_C] = law("gap") + law("coil_gap")  # one law serves both flux paths
    x[GAP_C_SQ], x[GAP_M_SQ] = x[GAP_C] ** 2, x[GAP_M] ** 2
