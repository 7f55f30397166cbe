"""Whether a rig's numbers make its magnet work: what each kind needs, and that its bias carries the weight."""

from typing import TYPE_CHECKING

from maglev_env.loop.magnets.law import balancing_bias, force, geometric_law, linearise

if TYPE_CHECKING:
    from maglev_env.rig.rig import Rig

SINGLE_SIDED = ("electromagnet", "magnet_coil")
BALANCE = 0.01  # share of the weight by which the pull of a given bias may miss it
MAX_BIAS = 1e3  # A


def check_magnet(rig: "Rig") -> None:
    """ValueError naming the parameter that is missing, belongs to another kind of magnet, or does not carry the weight.

    Ranges are taken as checked.
    """
    kind = rig.magnet
    if kind == "hybrid_pair" and not rig.remanence:
        raise ValueError("remanence: a hybrid pair needs its magnets' remanence in T")
    if kind.startswith("electromagnet") and rig.remanence:
        raise ValueError(
            f"remanence = {rig.remanence} T: an {kind} has no permanent magnet; leave it out, or use another magnet"
        )
    if kind == "electromagnet_pair" and not rig.bias_current:
        raise ValueError(
            "bias_current: an electromagnet_pair needs one in A; without bias a small current has no force"
        )
    if rig.flux_path == "magnet" and kind in ("electromagnet_pair", *SINGLE_SIDED):
        raise ValueError(f"flux_path = 'magnet' belongs to the hybrid_pair; leave it out for the {kind}")
    for name in ("force_constant", "force_exponent"):
        given = getattr(rig, name) is not None
        if given and kind != "magnet_coil":
            raise ValueError(f"{name} belongs to magnet = 'magnet_coil'; leave it out for {kind!r}")
        if not given and kind == "magnet_coil":
            raise ValueError(
                f"{name} is missing: a magnet_coil pulls force_constant (N m^n/A) times current over distance^n, "
                "with n the force_exponent"
            )
    if kind == "magnet_coil" and rig.bearings != 1:
        raise ValueError(
            f"bearings = {rig.bearings}: a magnet_coil's force_constant is that of all coils; leave it out"
        )
    if kind in SINGLE_SIDED:
        if rig.axes != 1:
            raise ValueError(f"axes = {rig.axes}: one {kind} carries a weight along one axis; use axes = 1, or a pair")
        _check_balance(rig)


def _check_balance(rig: "Rig") -> None:
    if not rig.gravity:
        raise ValueError(
            f"gravity = 0: {rig.magnet} pulls one way only and needs a weight to balance; use a pair, or give gravity"
        )
    geometry = "force_constant, force_exponent" if rig.magnet == "magnet_coil" else "turns, pole_area"
    needed = balancing_bias(rig)
    law = geometric_law(rig)
    correct = f"correct {geometry}, gap or mass"
    weight = f"the weight is {law.weight:.3g} N (mass {rig.mass:.4g} kg, gravity {rig.gravity:.4g} m/s2)"
    if abs(needed) > MAX_BIAS:
        raise ValueError(
            f"bias_current: {needed:.3g} A would balance the weight at gap {rig.gap * 1e3:g} mm; {correct}"
        )
    residual = force(law, 0.0, 0.0)
    if rig.bias_current and abs(residual) > BALANCE * law.weight:
        raise ValueError(
            f"bias_current = {rig.bias_current:g} A pulls {law.weight + residual:.3g} N at gap {rig.gap * 1e3:g} mm, "
            f"{weight}; leave bias_current out to have it computed ({needed:.3g} A), or {correct}"
        )
    if rig.negative_stiffness is not None and linearise(law)[1] >= 0:
        raise ValueError(
            f"negative_stiffness = {rig.negative_stiffness:g} N/m: by its geometry the magnet is not unstable at gap "
            f"{rig.gap * 1e3:g} mm, its attraction to the iron exceeding the weight; leave it out, or correct remanence"
        )
