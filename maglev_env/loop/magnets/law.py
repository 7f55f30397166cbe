"""Force laws of the magnets and their linearisation (D eq 3.9-3.13; Schweitzer and Maslen 2009)."""

from dataclasses import dataclass, replace
from functools import singledispatch
from math import inf, isinf

import numpy as np


@dataclass(frozen=True)
class ForceLaw:
    """Constants of a pair of opposed magnets, ready for evaluation.

    With b(x) = magnet_flux / (x + magnet_gap) and q(x) = coil_flux / (x + coil_gap) for the upper (x = gap - y) and
    lower (x = gap + y) magnet, B = b + q (bias_current +- gain_scale i), and
    f = area [ stiffness_scale (B_u^2 - B_l^2)|_(i=0) + force_scale (the part that depends on i) ].
    With another exponent of the gap each B^2 is multiplied by ((gap + shift) / (x + shift))^exponent.
    Iron that saturates makes B / (1 + |B / B_s|^n)^((1 - creep) / n) of each B, where B_s = saturation
    ((x + shift) / (gap + shift))^(creep / (1 - creep)). Far beyond the knee B grows as the power creep of the current.
    Iron whose field strength goes as B^(1 / creep), in series with a gap, does exactly this there: where most of the
    ampere-turns drive the iron, B does not depend on the gap.

    Args:
        area: N/T^2; n_b A_g / (2 mu_0) for hybrid magnets, one pole face each as D counts them, and n_b A_g / mu_0 for
            electromagnets (magnet_flux = 0), both faces.
        gap: m.
        magnet_flux: T m.
        magnet_gap: reluctance of the permanent magnet as an air gap, m.
        coil_flux: T m/A.
        coil_gap: the part of that reluctance that the control flux passes, m.
        bias_current: A.
        gain_scale: calibration of the actuator gain.
        stiffness_scale: calibration of the negative stiffness.
        saturation: T; infinite: no saturation.
        sharpness: n.
        creep: how the field grows beyond the knee; 0: not at all.
        exponent: what another law adds to the exponent of the gap.
        shift: what another law adds to the gap, m; magnet_gap and coil_gap include it.
        force_scale: calibration of the part that depends on the current.
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
    saturation: float = inf
    sharpness: float = 4.0
    creep: float = 0.0
    exponent: float = 0.0
    shift: float = 0.0
    force_scale: float = 1.0

    @property
    def rest_current(self) -> float:
        """What of the current carries the weight, A: nothing, since the magnets of a pair balance each other."""
        return 0.0


@dataclass(frozen=True)
class SingleSidedLaw:
    """Constants of one magnet above the rotor, ready for evaluation.

    With x = gap - y, I = bias_current + gain_scale i, s = exp(-decay x) / (x + coil_gap)^exponent and
    p(y, I) = (iron_pull I^2 + magnet_pull I) s + area (magnet_flux / (x + magnet_gap))^2 - weight,
    f = stiffness_scale p(y, bias_current) + force_scale [p(y, I) - p(y, bias_current)].
    The second term of p is the attraction of a permanent magnet on the rotor to the iron of the coil.

    Args:
        gap: m.
        iron_pull: of the coil on iron, N m^exponent/A2; 0 for a magnet below a coil.
        magnet_pull: of the coil on a permanent magnet, N m^exponent/A; 0 for an electromagnet.
        exponent: of the distance in the coil's pull.
        area: N/T^2.
        magnet_flux: T m.
        magnet_gap: reluctance of the permanent magnet as an air gap, m.
        weight: N.
        bias_current: A.
        gain_scale: calibration of the actuator gain.
        stiffness_scale: calibration of the negative stiffness.
        coil_gap: what the coil's pull adds to the distance, m.
        decay: rate of its exponential decay, 1/m.
        force_scale: calibration of the part that depends on the current.
    """

    gap: float
    iron_pull: float
    magnet_pull: float
    exponent: float
    area: float
    magnet_flux: float
    magnet_gap: float
    weight: float
    bias_current: float
    gain_scale: float
    stiffness_scale: float
    coil_gap: float = 0.0
    decay: float = 0.0
    force_scale: float = 1.0

    @property
    def rest_current(self) -> float:
        """What of the current carries the weight, A."""
        return self.bias_current

    def falloff(self, x: np.ndarray | float) -> np.ndarray | float:
        """How the coil's pull falls off with the distance x (m): s above, in 1/m^exponent."""
        return np.exp(-self.decay * x) / (x + self.coil_gap) ** self.exponent

    @property
    def steepness(self) -> float:
        """How steeply the coil's pull falls off at y = 0, -d ln s / dx in 1/m."""
        return self.exponent / (self.gap + self.coil_gap) + self.decay


@singledispatch
def reshaped(law: ForceLaw, exponent: float, offset: float) -> ForceLaw:
    """A law whose pull falls off otherwise with the gap: 1 / (x + offset)^(n + exponent) in place of 1 / x^n.

    At y = 0 the pull of each magnet stays what it is, at every current, and so do the balance and the actuator gain.
    Of a pair both magnets change. The attraction of a permanent magnet to the iron of its coil has its own circuit and
    stays.

    Args:
        law: the law without this change.
        exponent: what is added to the exponent of the gap.
        offset: what is added to the gap, as a share of the gap; above -1.
    """
    shift = offset * law.gap
    magnet, coil = law.gap + law.magnet_gap, law.gap + law.coil_gap
    return replace(
        law,
        magnet_gap=law.magnet_gap + shift,
        coil_gap=law.coil_gap + shift,
        magnet_flux=law.magnet_flux * (magnet + shift) / magnet,
        coil_flux=law.coil_flux * (coil + shift) / coil,
        exponent=exponent,
        shift=shift,
    )


@reshaped.register
def _(law: SingleSidedLaw, exponent: float, offset: float) -> SingleSidedLaw:
    other = replace(law, exponent=law.exponent + exponent, coil_gap=law.coil_gap + offset * law.gap)
    same = float(law.falloff(law.gap) / other.falloff(law.gap))
    return replace(other, iron_pull=law.iron_pull * same, magnet_pull=law.magnet_pull * same)


@singledispatch
def with_distances_over(law: ForceLaw, factor: float) -> ForceLaw:
    """A law whose pull at a displacement y is that of the given one at factor * y: all its distances are divided by the
    factor.

    At y = 0 the pull stays what it is, at every current; the stiffness is multiplied by the factor.
    """
    magnet, coil, own = ((law.gap + more) / factor - law.gap for more in (law.magnet_gap, law.coil_gap, law.shift))
    return replace(
        law,
        magnet_gap=magnet,
        coil_gap=coil,
        shift=own,
        magnet_flux=law.magnet_flux / factor,
        coil_flux=law.coil_flux / factor,
    )


@with_distances_over.register
def _(law: SingleSidedLaw, factor: float) -> SingleSidedLaw:
    magnet, coil = ((law.gap + more) / factor - law.gap for more in (law.magnet_gap, law.coil_gap))
    other = replace(
        law, magnet_gap=magnet, coil_gap=coil, decay=law.decay * factor, magnet_flux=law.magnet_flux / factor
    )
    same = float(law.falloff(law.gap) / other.falloff(law.gap))
    return replace(other, iron_pull=law.iron_pull * same, magnet_pull=law.magnet_pull * same)


def field_at_rest(law: ForceLaw) -> float:
    """Flux density (T) in both gaps of a pair at y = 0 and i = 0, without saturation."""
    magnet, coil = law.gap + law.magnet_gap, law.gap + law.coil_gap
    return law.magnet_flux / magnet + law.coil_flux * law.bias_current / coil


@singledispatch
def linearise(law: ForceLaw, displacement: float = 0.0) -> tuple[float, float]:
    """Actuator gain df/di (N/A) and stiffness -df/dy (N/m) of a law at a displacement (m) and i = 0.

    They are exact derivatives. The stiffness is negative, except that of a magnet which its coil pushes away: it may be
    positive.
    """
    gain = stiffness = 0.0
    for gap in (law.gap - displacement, law.gap + displacement):
        steeper = _steeper(gap, law)
        b, q = law.magnet_flux / (gap + law.magnet_gap), law.coil_flux / (gap + law.coil_gap)
        field = b + q * law.bias_current
        slope = b / (gap + law.magnet_gap) + q * law.bias_current / (gap + law.coil_gap)
        # Derivatives of the pull by the field, and by the gap through the exponent and the knee.
        pull = law.area * _saturated(field, gap, law) * steeper
        beyond = float(_beyond_knee(field, gap, law))
        bent = 2 * pull / field * (1 - (1 - law.creep) * beyond) if field else 0.0
        apart = pull * (law.exponent - 2 * law.creep * beyond) / (gap + law.shift)
        gain += bent * q * law.gain_scale * law.force_scale
        stiffness -= (bent * slope + apart) * law.stiffness_scale
    return gain, stiffness


@linearise.register
def _(law: SingleSidedLaw, displacement: float = 0.0) -> tuple[float, float]:
    x, bias = law.gap - displacement, law.bias_current
    iron, magnet = law.iron_pull * law.falloff(x), law.magnet_pull * law.falloff(x)
    attraction = law.area * (law.magnet_flux / (x + law.magnet_gap)) ** 2
    steepness = law.exponent / (x + law.coil_gap) + law.decay  # of the coil's pull, -d ln s / dx
    slope = bias * (iron * bias + magnet) * steepness + 2 * attraction / (x + law.magnet_gap)
    return (2 * iron * bias + magnet) * law.gain_scale * law.force_scale, -slope * law.stiffness_scale


@singledispatch
def force(law: ForceLaw, displacement: np.ndarray | float, current: np.ndarray | float) -> np.ndarray | float:
    """Force of a law, positive toward the upper magnet. Pairs: D eq 3.10, with both flux paths.

    Args:
        law: the force law; single-sided laws include the weight, those of pairs do not.
        displacement: m.
        current: control current, A; broadcasts with displacement.

    Returns:
        N, in the common shape of displacement and current.
    """
    upper, lower = law.gap - displacement, law.gap + displacement
    qu, ql = law.coil_flux / (upper + law.coil_gap), law.coil_flux / (lower + law.coil_gap)
    bu = law.magnet_flux / (upper + law.magnet_gap) + qu * law.bias_current
    bl = law.magnet_flux / (lower + law.magnet_gap) + ql * law.bias_current
    i = law.gain_scale * current
    if isinf(law.saturation) and not law.exponent:
        driven = i * (2 * (bu * qu + bl * ql) + i * (qu * qu - ql * ql))
        return law.area * (law.stiffness_scale * (bu * bu - bl * bl) + law.force_scale * driven)
    above, below = _steeper(upper, law), _steeper(lower, law)
    at_rest = above * _saturated(bu, upper, law) - below * _saturated(bl, lower, law)
    driven = above * _saturated(bu + qu * i, upper, law) - below * _saturated(bl - ql * i, lower, law)
    return law.area * (law.stiffness_scale * at_rest + law.force_scale * (driven - at_rest))


def _saturated(field: np.ndarray | float, gap: np.ndarray | float, law: ForceLaw) -> np.ndarray | float:
    """The squared field (T^2) of a gap (m) with saturation: the square of small fields, and of large ones what the iron
    lets through."""
    if law.sharpness == 4 and not law.creep:
        return field**2 / np.sqrt(1 + (field / law.saturation) ** 4)
    return field**2 / (1 + _knees(field, gap, law) ** law.sharpness) ** (2 * (1 - law.creep) / law.sharpness)


def _beyond_knee(field: np.ndarray | float, gap: np.ndarray | float, law: ForceLaw) -> np.ndarray | float:
    """r^n / (1 + r^n) for a field of r times that of the knee: 0 far below it, 1 far above."""
    return 1 - 1 / (1 + _knees(field, gap, law) ** law.sharpness)


def _knees(field: np.ndarray | float, gap: np.ndarray | float, law: ForceLaw) -> np.ndarray | float:
    """A field that no iron holds back, by that at which the iron in series with this gap saturates."""
    wider = (gap + law.shift) / (law.gap + law.shift)
    return abs(field) / (law.saturation * wider ** (law.creep / (1 - law.creep)))


def _steeper(gap: np.ndarray | float, law: ForceLaw) -> np.ndarray | float:
    """Factor on the pull of a magnet at a gap (m) by another exponent; 1 at the resting gap, nan beyond contact."""
    with np.errstate(invalid="ignore"):
        return ((law.gap + law.shift) / (gap + law.shift)) ** law.exponent


@force.register
def _(law: SingleSidedLaw, displacement: np.ndarray | float, current: np.ndarray | float) -> np.ndarray | float:
    x, bias, i = law.gap - displacement, law.bias_current, law.gain_scale * current
    iron, magnet = law.iron_pull * law.falloff(x), law.magnet_pull * law.falloff(x)
    attraction = law.area * (law.magnet_flux / (x + law.magnet_gap)) ** 2
    resting = bias * (iron * bias + magnet) + attraction - law.weight
    return law.stiffness_scale * resting + law.force_scale * i * (iron * (2 * bias + i) + magnet)
