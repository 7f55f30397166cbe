"""A magnet on the rotor below a coil, whose measured pull is force_constant (N m^n/A) times current over distance^n."""

from maglev_env.loop.magnets.check import check_balance, refuse_flux_path
from maglev_env.loop.magnets.circuit import magnet_attraction, single_sided_law
from maglev_env.loop.magnets.law import SingleSidedLaw
from maglev_env.loop.magnets.magnet import Magnet, MagnetKind
from maglev_env.loop.magnets.rows import BIAS, CALIBRATION, EXPONENT, FLUX_C, FLUX_M, GAP, GAP_M, WEIGHT
from maglev_lanes.pieces import piece


def law(m: Magnet) -> SingleSidedLaw:
    """A pull linear in the current. If no bias is given, it is the one that balances the weight."""
    bias = m.bias_current or balancing_bias(m)
    return single_sided_law(m, bias, m.force_exponent, magnet_pull=m.force_constant)


def balancing_bias(m: Magnet) -> float:
    """Bias current (A) with which the coil carries the weight at y = 0, i = 0.

    It is negative if the magnet's attraction to the iron of the coil exceeds the weight; the coil then pushes.
    """
    return (m.mass * m.gravity - magnet_attraction(m)) * m.gap**m.force_exponent / m.force_constant


def check(m: Magnet) -> None:
    """Raise ValueError for missing parameters or those of other kinds, two axes, or a bias that misses the weight."""
    refuse_flux_path(m)
    for name in KIND.own:
        if getattr(m, name) is None:
            raise ValueError(
                f"{name} is missing: a magnet_coil pulls force_constant (N m^n/A) times current over distance^n, "
                "with n the force_exponent"
            )
    if m.bearings != 1:
        raise ValueError(f"bearings = {m.bearings}: a magnet_coil's force_constant is that of all coils; leave it out")
    check_balance(m, law, balancing_bias, "force_constant, force_exponent")


@piece
def pull(x, k, y, current):
    """Acceleration by the magnet minus that by the weight (see `magnets.law.SingleSidedLaw`)."""
    coil = x[k + FLUX_C] * (x[k + GAP] - y) ** (-x[k + EXPONENT])
    magnet = x[k + FLUX_M] / (x[k + GAP_M] - y)
    at_bias = coil * x[k + BIAS] + magnet * magnet
    return x[k + CALIBRATION] * at_bias - x[k + WEIGHT] + coil * current


KIND = MagnetKind(
    law,
    check,
    pull,
    pair=False,
    inductance_follows_gap=False,
    balancing_bias=balancing_bias,
    own=("force_constant", "force_exponent"),
)
