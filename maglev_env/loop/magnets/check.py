"""Checks that several kinds of magnet share: parameters of permanent magnets only, and the balance of the weight."""

from collections.abc import Callable

from maglev_env.loop.magnets.law import SingleSidedLaw, force, linearise
from maglev_env.loop.magnets.magnet import Magnet

BALANCE = 0.01  # tolerance between the pull of a given bias and the weight, as a share of the weight
MAX_BIAS = 1e3  # A


def refuse_remanence(m: Magnet) -> None:
    """Raise ValueError if an electromagnet has the remanence of a permanent magnet."""
    if m.remanence:
        raise ValueError(
            f"remanence = {m.remanence} T: an {m.magnet} has no permanent magnet; leave it out, or use another magnet"
        )


def refuse_flux_path(m: Magnet) -> None:
    """Raise ValueError if flux_path = "magnet"; only the control flux of a hybrid pair can close through a magnet."""
    if m.flux_path == "magnet":
        raise ValueError(f"flux_path = 'magnet' belongs to the hybrid_pair; leave it out for the {m.magnet}")


def check_balance(
    m: Magnet, law_of: Callable[[Magnet], SingleSidedLaw], bias_of: Callable[[Magnet], float], geometry: str
) -> None:
    """Check that a single-sided magnet has one axis and that its bias carries the weight.

    Args:
        m: the magnet's values.
        law_of: gives its law by geometry alone.
        bias_of: gives its balancing bias (A).
        geometry: names of the parameters that determine its pull, for the message.

    Raises:
        ValueError: There are two axes, no weight, or the bias does not carry the weight.
    """
    if m.axes != 1:
        raise ValueError(f"axes = {m.axes}: one {m.magnet} carries a weight along one axis; use axes = 1, or a pair")
    if not m.gravity:
        raise ValueError(
            f"gravity = 0: {m.magnet} pulls one way only and needs a weight to balance; use a pair, or give gravity"
        )
    needed, law = bias_of(m), law_of(m)
    correct = f"correct {geometry}, gap or mass"
    weight = f"the weight is {law.weight:.3g} N (mass {m.mass:.4g} kg, gravity {m.gravity:.4g} m/s2)"
    if abs(needed) > MAX_BIAS:
        raise ValueError(f"bias_current: {needed:.3g} A would balance the weight at gap {m.gap * 1e3:g} mm; {correct}")
    residual = force(law, 0.0, 0.0)
    if m.bias_current and abs(residual) > BALANCE * law.weight:
        raise ValueError(
            f"bias_current = {m.bias_current:g} A pulls {law.weight + residual:.3g} N at gap {m.gap * 1e3:g} mm, "
            f"{weight}; leave bias_current out to have it computed ({needed:.3g} A), or {correct}"
        )
    if m.negative_stiffness is not None and linearise(law)[1] >= 0:
        raise ValueError(
            f"negative_stiffness = {m.negative_stiffness:g} N/m: by its geometry the magnet is not unstable at gap "
            f"{m.gap * 1e3:g} mm, its attraction to the iron exceeding the weight; leave it out, or correct remanence"
        )
