"""One electromagnet above the rotor; its pull on the iron must balance the weight.

With x the gap, it pulls C I^2 / (x + gap_offset)^force_exponent, or C I^2 exp(-x / force_length). C is the
force_constant; or it follows from turns and pole_area, or from the bias_current that carries the weight.
"""

from math import exp

from maglev_env.loop.magnets.check import check_balance, refuse_flux_path, refuse_remanence
from maglev_env.loop.magnets.circuit import single_sided_law
from maglev_env.loop.magnets.law import SingleSidedLaw
from maglev_env.loop.magnets.magnet import Magnet, MagnetKind
from maglev_env.loop.magnets.powers import exponential, logarithm
from maglev_env.loop.magnets.rows import (
    BIAS,
    CALIBRATION,
    DECAY,
    EXPONENT,
    FLUX_C,
    GAP,
    PER_GAP,
    WEIGHT,
)  # fmt: skip
from maglev_lanes.pieces import piece
from selfsense.coil import MU_0

SQUARE = 2.0  # exponent of the gap by the magnetic circuit


def law(m: Magnet) -> SingleSidedLaw:
    """A pull in proportion to the squared current. If no bias is given, it is the one that balances the weight."""
    decay = 1 / m.force_length if m.force_length else 0.0
    return single_sided_law(
        m, m.bias_current or balancing_bias(m), _exponent(m), iron_pull=_constant(m), coil_gap=m.gap_offset, decay=decay
    )


def balancing_bias(m: Magnet) -> float:
    """Bias current (A) with which the magnet carries the weight at y = 0, i = 0."""
    return (m.mass * m.gravity / (_constant(m) * _falloff(m))) ** 0.5


def check(m: Magnet) -> None:
    """Raise ValueError for parameters of other magnets or of two laws, and if the bias does not carry the weight."""
    refuse_remanence(m)
    refuse_flux_path(m)
    if m.force_length is not None:
        for name, given in (("force_exponent", m.force_exponent is not None), ("gap_offset", m.gap_offset > 0)):
            if given:
                raise ValueError(
                    f"{name} beside force_length: the pull falls off as 1 / (x + gap_offset)^force_exponent or as "
                    "exp(-x / force_length); leave one of them out"
                )
    if not square(m) and m.force_constant is None and not m.bias_current:
        raise ValueError(
            "force_constant is missing: turns and pole_area give the pull for force_exponent = 2 only; give "
            "force_constant, or the bias_current that carries the weight"
        )
    if m.force_constant is not None and m.bearings != 1:
        raise ValueError(f"bearings = {m.bearings}: the force_constant is that of all coils; leave bearings out")
    check_balance(m, law, balancing_bias, "turns, pole_area" if m.force_constant is None else "force_constant")
    if m.force_constant is None and not m.bias_current and not knows_turns(m):
        raise ValueError(
            "bias_current is missing: nothing says how hard the electromagnet pulls; give the bias_current that "
            "carries the weight at the gap, or turns and pole_area, or force_constant"
        )


def square(m: Magnet) -> bool:
    """Whether the pull falls off with the square of a distance, as by the magnetic circuit."""
    return _exponent(m) == SQUARE


def knows_turns(m: Magnet) -> bool:
    """Whether the coil's turns are given: one turn, the default, stands for an unknown number."""
    return m.turns > 1


def _exponent(m: Magnet) -> float:
    if m.force_length is not None:
        return 0.0
    return SQUARE if m.force_exponent is None else m.force_exponent


def _falloff(m: Magnet) -> float:
    """How far the pull has fallen off at y = 0, 1/m^n."""
    return exp(-m.gap / m.force_length) if m.force_length else (m.gap + m.gap_offset) ** -_exponent(m)


def _constant(m: Magnet) -> float:
    """C in N m^n/A2: as given, by the geometry, or else by the balance of pull and weight."""
    if m.force_constant is not None:
        return m.force_constant
    if m.bias_current and m.gravity and not (square(m) and knows_turns(m)):
        return m.mass * m.gravity / (m.bias_current**2 * _falloff(m))
    return m.bearings * MU_0 * m.turns**2 * m.pole_area / 4


@piece
def pull(x, k, y, current):
    """Acceleration by the magnet minus that by the weight (see `magnets.law.SingleSidedLaw`)."""
    coil = x[k + FLUX_C] / (x[k + GAP] - y)
    bias, drive = x[k + BIAS] * coil, current * coil
    at_bias = x[k + CALIBRATION] * (bias * bias) - x[k + WEIGHT]
    return at_bias + drive * (2.0 * bias + drive)


@piece
def _shaped(x, k, y, current):
    """The same for a pull that falls off with any exponent, or exponentially."""
    coil, bias = x[k + FLUX_C] * x[k + PER_GAP], x[k + BIAS]
    nearer = logarithm(1.0 - y * x[k + PER_GAP])
    per_square = coil * coil * exponential(y * x[k + DECAY] - x[k + EXPONENT] * nearer)
    at_bias = x[k + CALIBRATION] * (bias * bias * per_square) - x[k + WEIGHT]
    return at_bias + per_square * current * (2.0 * bias + current)


KIND = MagnetKind(
    law,
    check,
    pull,
    lambda saturating, steeper, any_knee: _shaped,
    pair=False,
    inductance_follows_gap=True,
    plain=square,
    balancing_bias=balancing_bias,
    optional=("force_constant", "force_exponent", "force_length", "gap_offset"),
)
