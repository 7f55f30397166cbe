"""Two opposed electromagnets with a bias current (Schweitzer and Maslen 2009)."""

from dataclasses import replace

from maglev_env.loop.magnets.check import refuse_flux_path, refuse_remanence
from maglev_env.loop.magnets.circuit import pair_law
from maglev_env.loop.magnets.electromagnet import knows_turns
from maglev_env.loop.magnets.hybrid_pair import pull, shaped_pull
from maglev_env.loop.magnets.law import ForceLaw, linearise
from maglev_env.loop.magnets.magnet import Magnet, MagnetKind
from selfsense.coil import MU_0


def law(m: Magnet) -> ForceLaw:
    """A hybrid pair without permanent magnet whose control flux closes through the gaps; both pole faces.

    Where the turns are not known, the actuator gain says how strong the magnets are. Calibrating the current instead,
    as where the geometry is known, would make the control current look many times the bias.
    """
    found = pair_law(m, m.bearings * m.pole_area / MU_0, 0.0, 0.0, 0.0)
    if knows_turns(m) or m.actuator_gain is None:
        return found
    return replace(found, coil_flux=found.coil_flux * (m.actuator_gain / linearise(found)[0]) ** 0.5)


def check(m: Magnet) -> None:
    """Raise ValueError for a permanent magnet, a missing bias or strength, or a flux path that only hybrid magnets
    have."""
    refuse_remanence(m)
    if not m.bias_current:
        raise ValueError(
            "bias_current: an electromagnet_pair needs one in A; without bias a small current has no force"
        )
    if not knows_turns(m) and m.actuator_gain is None:
        raise ValueError(
            "turns: nothing says how strong the electromagnet_pair is; give turns and pole_area, or the measured "
            "actuator_gain in N/A"
        )
    refuse_flux_path(m)


KIND = MagnetKind(law, check, pull, shaped_pull, pair=True, inductance_follows_gap=True)
