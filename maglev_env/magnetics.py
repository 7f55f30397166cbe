"""The hybrid pair: force law, its linearisation and calibration (D eq 3.9-3.13)."""

from dataclasses import dataclass

import numpy as np

from maglev_env.rig import Rig
from selfsense.coil import MU_0, coil_inductance

__all__ = ["MU_0", "ForceLaw", "force", "force_law", "inductance"]


@dataclass(frozen=True)
class ForceLaw:
    """Constants of the hybrid pair's law, ready for evaluation.

    With b(x) = magnet_flux / (x + magnet_gap) and q(x) = coil_flux / (x + coil_gap) for the upper (x = gap - y) and
    lower (x = gap + y) magnet, B = b + q (bias_current +- gain_scale i), and
    f = area [ stiffness_scale (B_u^2 - B_l^2)|_(i=0) + the rest ].
    Fluxes in T m and T m/A, gaps in m, area = n_b A_g / (2 mu_0) in N/T^2.
    """

    area: float
    gap: float
    magnet_flux: float
    magnet_gap: float
    coil_flux: float
    coil_gap: float
    bias_current: float
    gain_scale: float
    stiffness_scale: float


def force_law(rig: Rig) -> ForceLaw:
    """The rig's force law, calibrated to its actuator_gain and negative_stiffness where it gives them.

    ValueError for a rig without magnets.
    """
    if rig.magnet != "hybrid_pair":
        raise ValueError(f"rig {rig.name}: magnet = {rig.magnet!r} has no force law")
    mu_m = rig.recoil_permeability * MU_0
    reluctance_gap = 0.5 * MU_0 * rig.magnet_length * rig.pole_area / (mu_m * rig.magnet_area)
    raw = ForceLaw(
        area=rig.bearings * rig.pole_area / (2 * MU_0),
        gap=rig.gap,
        magnet_flux=0.5 * MU_0 * rig.remanence * rig.magnet_length / mu_m,
        magnet_gap=reluctance_gap,
        coil_flux=0.5 * MU_0 * rig.turns,
        coil_gap=0.0 if rig.flux_path == "gap" else reluctance_gap,
        bias_current=rig.bias_current,
        gain_scale=1.0,
        stiffness_scale=1.0,
    )
    gain, stiffness = linearise(raw)
    return ForceLaw(
        **{
            **vars(raw),
            "gain_scale": 1.0 if rig.actuator_gain is None else rig.actuator_gain / gain,
            "stiffness_scale": 1.0 if rig.negative_stiffness is None else rig.negative_stiffness / stiffness,
        }
    )


def linearise(law: ForceLaw) -> tuple[float, float]:
    """Actuator gain df/di (N/A) and stiffness -df/dy (N/m, negative) at y = 0, i = 0, by differentiating the law."""
    b = law.magnet_flux / (law.gap + law.magnet_gap)
    q = law.coil_flux / (law.gap + law.coil_gap)
    field = b + q * law.bias_current
    slope = b / (law.gap + law.magnet_gap) + q * law.bias_current / (law.gap + law.coil_gap)
    return 4 * law.area * field * q * law.gain_scale, -4 * law.area * field * slope * law.stiffness_scale


def force(law: ForceLaw, displacement: np.ndarray | float, current: np.ndarray | float) -> np.ndarray | float:
    """Force (N) toward the upper magnet at displacement (m) and control current (A); D eq 3.10, both flux paths."""
    upper, lower = law.gap - displacement, law.gap + displacement
    qu, ql = law.coil_flux / (upper + law.coil_gap), law.coil_flux / (lower + law.coil_gap)
    bu = law.magnet_flux / (upper + law.magnet_gap) + qu * law.bias_current
    bl = law.magnet_flux / (lower + law.magnet_gap) + ql * law.bias_current
    i = law.gain_scale * current
    return law.area * (
        law.stiffness_scale * (bu * bu - bl * bl) + i * (2 * (bu * qu + bl * ql) + i * (qu * qu - ql * ql))
    )


def inductance(rig: Rig, displacement: float = 0.0) -> float:
    """Inductance (H) of the upper coil with the rotor at displacement (m)."""
    return coil_inductance(rig.gap - displacement, rig.turns, rig.pole_area)
