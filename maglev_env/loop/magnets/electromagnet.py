"""One electromagnet above the rotor; its pull on the iron must balance the weight."""

from maglev_env.loop.magnets.check import check_balance, refuse_flux_path, refuse_remanence
from maglev_env.loop.magnets.circuit import single_sided_law
from maglev_env.loop.magnets.law import SingleSidedLaw
from maglev_env.loop.magnets.magnet import Magnet, MagnetKind
from maglev_env.loop.magnets.rows import BIAS, CALIBRATION, FLUX_C, GAP, WEIGHT
from maglev_lanes.pieces import piece
from selfsense.coil import MU_0


def law(m: Magnet) -> SingleSidedLaw:
    """A pull in proportion to (current / distance)^2. If no bias is given, it is the one that balances the weight."""
    return single_sided_law(m, m.bias_current or balancing_bias(m), iron_pull=_iron_pull(m))


def balancing_bias(m: Magnet) -> float:
    """Bias current (A) with which the magnet carries the weight at y = 0, i = 0."""
    return m.gap * (m.mass * m.gravity / _iron_pull(m)) ** 0.5


def check(m: Magnet) -> None:
    """Raise ValueError for parameters of permanent magnets, for two axes, and if the bias does not carry the weight."""
    refuse_remanence(m)
    refuse_flux_path(m)
    check_balance(m, law, balancing_bias, "turns, pole_area")


def _iron_pull(m: Magnet) -> float:
    return m.bearings * MU_0 * m.turns**2 * m.pole_area / 4


@piece
def pull(x, k, y, current):
    """Acceleration by the magnet minus that by the weight (see `magnets.law.SingleSidedLaw`)."""
    coil = x[k + FLUX_C] / (x[k + GAP] - y)
    bias, drive = x[k + BIAS] * coil, current * coil
    at_bias = x[k + CALIBRATION] * (bias * bias) - x[k + WEIGHT]
    return at_bias + drive * (2.0 * bias + drive)


KIND = MagnetKind(law, check, pull, pair=False, inductance_follows_gap=True, balancing_bias=balancing_bias)
