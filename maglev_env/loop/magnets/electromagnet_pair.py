"""Two opposed electromagnets with a bias current (Schweitzer and Maslen 2009)."""

from maglev_env.loop.magnets.check import refuse_flux_path, refuse_remanence
from maglev_env.loop.magnets.circuit import pair_law
from maglev_env.loop.magnets.hybrid_pair import pull, shaped_pull
from maglev_env.loop.magnets.law import ForceLaw
from maglev_env.loop.magnets.magnet import Magnet, MagnetKind
from selfsense.coil import MU_0


def law(m: Magnet) -> ForceLaw:
    """A hybrid pair without permanent magnet whose control flux closes through the gaps; both pole faces."""
    return pair_law(m, m.bearings * m.pole_area / MU_0, 0.0, 0.0, 0.0)


def check(m: Magnet) -> None:
    """Raise ValueError for a permanent magnet, a missing bias, or a flux path that only hybrid magnets have."""
    refuse_remanence(m)
    if not m.bias_current:
        raise ValueError(
            "bias_current: an electromagnet_pair needs one in A; without bias a small current has no force"
        )
    refuse_flux_path(m)


KIND = MagnetKind(law, check, pull, shaped_pull, pair=True, inductance_follows_gap=True)
