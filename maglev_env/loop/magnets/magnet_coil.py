"""A magnet on the rotor below a coil: a measured pull force_constant (N m^n/A) times current over distance^n."""

from maglev_env.loop.magnets.check import check_balance, refuse_flux_path
from maglev_env.loop.magnets.circuit import magnet_attraction, single_sided_law
from maglev_env.loop.magnets.law import SingleSidedLaw
from maglev_env.loop.magnets.magnet import Magnet, MagnetKind
from maglev_env.loop.magnets.rows import BIAS, CALIBRATION, EXPONENT, FLUX_C, FLUX_M, GAP, GAP_M, WEIGHT
from maglev_lanes.pieces import piece


def law(m: Magnet) -> SingleSidedLaw:
    """Pull linear in the current; its bias balances the weight where none is given."""
    bias = m.bias_current or balancing_bias(m)
    return single_sided_law(m, bias, magnet_pull=m.force_constant, exponent=m.force_exponent)


def balancing_bias(m: Magnet) -> float:
    """Bias current (A) with which it carries the weight at y = 0, i = 0.

    Negative where the magnet's attraction to the iron of its coil exceeds the weight: the coil then pushes.
    """
    return (m.mass * m.gravity - magnet_attraction(m)) * m.gap**m.force_exponent / m.force_constant


def check(m: Magnet) -> None:
    """ValueError for what is missing or belongs to other kinds, for two axes, and when the bias misses the weight."""
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
    """Acceleration (see `magnets.law.SingleSidedLaw`), less the weight."""
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
