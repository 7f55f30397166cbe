"""Two opposed hybrid magnets: permanent magnets give the bias, coils the control flux (D eq 3.9-3.13)."""

from maglev_env.loop.magnets.circuit import magnet_circuit, pair_law
from maglev_env.loop.magnets.law import ForceLaw
from maglev_env.loop.magnets.magnet import Magnet, MagnetKind
from selfsense.coil import MU_0


def law(m: Magnet) -> ForceLaw:
    """The law of both flux paths; D counts one pole face per magnet."""
    magnet_flux, magnet_gap = magnet_circuit(m)
    coil_gap = 0.0 if m.flux_path == "gap" else magnet_gap
    return pair_law(m, m.bearings * m.pole_area / (2 * MU_0), magnet_flux, magnet_gap, coil_gap)


def check(m: Magnet) -> None:
    """ValueError when there is no permanent magnet."""
    if not m.remanence:
        raise ValueError("remanence: a hybrid pair needs its magnets' remanence in T")


KIND = MagnetKind(law, check, pull=lambda m: m.flux_path, pair=True, inductance_follows_gap=True)
