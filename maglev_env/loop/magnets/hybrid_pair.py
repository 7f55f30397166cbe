"""Two opposed hybrid magnets: permanent magnets make the bias flux, coils the control flux (D eq 3.9-3.13)."""

from collections.abc import Callable

from maglev_env.loop.magnets.circuit import magnet_circuit, pair_law
from maglev_env.loop.magnets.knee import creeping_share
from maglev_env.loop.magnets.law import ForceLaw
from maglev_env.loop.magnets.magnet import Magnet, MagnetKind
from maglev_env.loop.magnets.powers import exponential, logarithm
from maglev_env.loop.magnets.rows import (
    BEND,
    BIAS,
    CALIBRATION,
    EXPONENT,
    FLUX_C,
    FLUX_M,
    GAP_C,
    GAP_C_SQ,
    GAP_M,
    GAP_M_SQ,
    KNEE,
    PER_GAP,
    SLOWER,
    WIDENS,
)  # fmt: skip
from maglev_lanes.elementary import root
from maglev_lanes.pieces import piece
from selfsense.coil import MU_0


def law(m: Magnet) -> ForceLaw:
    """The law of both flux paths; D counts one pole face per magnet."""
    magnet_flux, magnet_gap = magnet_circuit(m)
    coil_gap = 0.0 if m.flux_path == "gap" else magnet_gap
    return pair_law(m, m.bearings * m.pole_area / (2 * MU_0), magnet_flux, magnet_gap, coil_gap)


def check(m: Magnet) -> None:
    """Raise ValueError if there is no permanent magnet."""
    if not m.remanence:
        raise ValueError("remanence: a hybrid pair needs its magnets' remanence in T")


@piece
def pull(x, k, y, current):
    """Acceleration (see `magnets.law.force`).

    It is computed from sums and differences of both gaps' fields, which needs one division only.
    """
    y2 = y * y
    a, c = x[k + GAP_C_SQ] - y2, x[k + GAP_M_SQ] - y2
    inverse = 1.0 / (a * c)
    magnet, coil = x[k + FLUX_M] * (a * inverse), x[k + FLUX_C] * (c * inverse)
    reach = x[k + GAP_C]
    bias = x[k + BIAS] * coil
    field_sum = x[k + GAP_M] * magnet + reach * bias
    slope = magnet + bias
    drive = current * coil
    bent = reach * (field_sum + drive * y) + slope * y2
    return x[k + CALIBRATION] * (y * field_sum * slope) + drive * bent


def shaped_pull(saturating: bool, steeper: bool, any_knee: bool) -> Callable:
    """A piece for pairs whose pull is not that of `pull`.

    Args:
        saturating: whether each gap's B^2 becomes B^2 / sqrt(1 + (B / B_s)^4).
        steeper: whether it also falls off with another exponent of the gap.
        any_knee: whether that knee has any sharpness and creeps.
    """

    @piece
    def gaps_to_power(x, k, y, power):
        """The gaps of the upper and the lower magnet, by that at y = 0, to a power."""
        closer = y * x[k + PER_GAP]
        return exponential(power * logarithm(1.0 - closer)), exponential(power * logarithm(1.0 + closer))

    @piece
    def knee_at(x, k, square, narrower):
        """What a squared field is divided by."""
        knee = x[k + KNEE]
        if any_knee:
            return 1.0 / creeping_share(root(knee) * square * narrower, x[k + BEND], x[k + SLOWER])
        return root(1.0 + knee * (square * square))

    @piece
    def narrower_knees(x, k, y):
        """What the squared fields of the upper and the lower magnet are by their knees, beside the same at y = 0."""
        if not any_knee:
            return 1.0, 1.0
        return gaps_to_power(x, k, y, -x[k + WIDENS])

    @piece
    def factors(x, k, y):
        """Of the upper and the lower magnet by another exponent."""
        if not steeper:
            return 1.0, 1.0
        return gaps_to_power(x, k, y, -x[k + EXPONENT])

    @piece
    def shaped(x, k, y, current):
        own, far = x[k + GAP_M] - y, x[k + GAP_M] + y
        near, wide = x[k + GAP_C] - y, x[k + GAP_C] + y
        inverse = 1.0 / ((own * far) * (near * wide))
        magnet = x[k + FLUX_M] * (near * wide * inverse)
        coil = x[k + FLUX_C] * (own * far * inverse)
        upper_coil, lower_coil = coil * wide, coil * near
        bias = x[k + BIAS]
        upper, lower = magnet * far + bias * upper_coil, magnet * own + bias * lower_coil
        s1, s2 = upper + current * upper_coil, lower - current * lower_coil
        s1, s2, s3, s4 = s1 * s1, s2 * s2, upper * upper, lower * lower
        above, below = factors(x, k, y)
        # The fields here are twice the physical ones, as in `pull`.
        if not saturating:
            return 0.25 * (above * s1 - below * s2 + (x[k + CALIBRATION] - 1.0) * (above * s3 - below * s4))
        up, down = narrower_knees(x, k, y)
        r1, r2 = knee_at(x, k, s1, up), knee_at(x, k, s2, down)
        r3, r4 = knee_at(x, k, s3, up), knee_at(x, k, s4, down)
        # One division serves all four terms.
        first_two, last_two = r1 * r2, r3 * r4
        inverse = 0.25 / (first_two * last_two)
        at_rest = (above * s3 * r4 - below * s4 * r3) * (first_two * inverse)
        return (above * s1 * r2 - below * s2 * r1) * (last_two * inverse) + (x[k + CALIBRATION] - 1.0) * at_rest

    return shaped


KIND = MagnetKind(law, check, pull, shaped_pull, pair=True, inductance_follows_gap=True)
