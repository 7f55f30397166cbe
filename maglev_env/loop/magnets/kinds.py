"""The registry of magnet kinds, and functions for magnets of any kind: law, inductance and check."""

from collections.abc import Container, Mapping
from dataclasses import replace

import numpy as np

from maglev_env.loop.magnets import electromagnet, electromagnet_pair, hybrid_pair, magnet_coil
from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw, linearise
from maglev_env.loop.magnets.magnet import Magnet, MagnetKind
from selfsense.coil import coil_inductance

KINDS: Mapping[str, MagnetKind] = {
    "hybrid_pair": hybrid_pair.KIND,
    "electromagnet_pair": electromagnet_pair.KIND,
    "electromagnet": electromagnet.KIND,
    "magnet_coil": magnet_coil.KIND,
}
NO_MAGNET = "none"
MAGNETS = (*KINDS, NO_MAGNET)  # valid values of a rig's magnet


def simulated_as(name: str) -> str:
    """The first kind of magnet that has the same pull in the kernel, or "none"; such kinds can share a batch."""
    if name == NO_MAGNET:
        return name
    return next(other for other, kind in KINDS.items() if kind.pull is KINDS[name].pull)


def steeper(m: Magnet, effects: Container[str]) -> bool:
    """Whether a magnet under these effects has a falloff with the gap that only the `shaped_pull` of its kind has."""
    kind = KINDS.get(m.magnet)
    return bool(kind and kind.shaped_pull) and ("force_law" in effects or not kind.plain(m))


def force_law(m: Magnet) -> ForceLaw | SingleSidedLaw:
    """A magnet's force law, calibrated to its actuator_gain and negative_stiffness if they are given.

    Raises:
        ValueError: There is no magnet.
    """
    law = geometric_law(m)
    gain, stiffness = linearise(law)
    return replace(
        law,
        gain_scale=1.0 if m.actuator_gain is None else m.actuator_gain / gain,
        stiffness_scale=1.0 if m.negative_stiffness is None else m.negative_stiffness / stiffness,
    )


def geometric_law(m: Magnet) -> ForceLaw | SingleSidedLaw:
    """The force law by a magnet's geometry alone, without calibration.

    Raises:
        ValueError: There is no magnet.
    """
    if m.magnet not in KINDS:
        raise ValueError(f"rig {m.name}: magnet = {m.magnet!r} has no force law")
    return KINDS[m.magnet].law(m)


def inductance(m: Magnet, displacement: np.ndarray | float = 0.0) -> np.ndarray | float:
    """Inductance (H) of the upper coil with the rotor at displacement (m); shape of displacement.

    A magnet below a coil pulls in proportion to the current, so the inductance of its coil does not depend on the
    displacement: it is coil_inductance.

    Raises:
        ValueError: There is no coil, or its turns or coil_inductance are needed and not given.
    """
    if m.magnet not in KINDS:
        raise ValueError(f"rig {m.name}: magnet = {m.magnet!r} has no coil")
    if KINDS[m.magnet].inductance_follows_gap:
        check_turns(m)
        return coil_inductance(m.gap + m.gap_offset - displacement, m.turns, m.pole_area)
    if m.coil_inductance is None:
        raise ValueError(f"rig {m.name}: coil_inductance is missing; a magnet below a coil needs it measured")
    return m.coil_inductance + 0 * displacement


def check_turns(m: Magnet) -> None:
    """Raise ValueError if the inductance of a coil is asked for whose turns are not given."""
    if not electromagnet.knows_turns(m):
        raise ValueError(
            f"rig {m.name}: turns is missing; the force law alone does not give the inductance of the coil: give turns "
            "and pole_area, beside the force law"
        )


def check_magnet(m: Magnet) -> None:
    """Check that a magnet's values are consistent; their ranges have been checked before.

    Raises:
        ValueError: A parameter is missing, belongs to another kind, or does not carry the weight; the message names it.
    """
    having: dict[str, list[str]] = {}
    for name, kind in KINDS.items():
        for parameter in (*kind.own, *kind.optional):
            having.setdefault(parameter, []).append(name)
    for parameter, names in having.items():
        if m.magnet not in names and getattr(m, parameter):
            known = " or ".join(map(repr, names))
            raise ValueError(f"{parameter} belongs to magnet = {known}; leave it out for {m.magnet!r}")
    if m.magnet in KINDS:
        KINDS[m.magnet].check(m)
        return
    for parameter in ("actuator_gain", "negative_stiffness"):
        if getattr(m, parameter) is not None:
            raise ValueError(
                f"{parameter} is a magnet's, and magnet = {m.magnet!r} has none; leave it out, or use one of "
                f"{', '.join(KINDS)}"
            )
