"""The values that a magnet's laws and checks read, and the contract that every kind of magnet fulfils."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw


class Magnet(Protocol):
    """The values that force laws and checks of one axis read, SI; a `Rig` has them all and checks their ranges."""

    @property
    def name(self) -> str: ...

    @property
    def magnet(self) -> str:
        """The kind: a name of `kinds.KINDS`, or "none"."""
        ...

    @property
    def axes(self) -> int: ...

    @property
    def mass(self) -> float: ...

    @property
    def gravity(self) -> float: ...

    @property
    def gap(self) -> float: ...

    @property
    def turns(self) -> float: ...

    @property
    def pole_area(self) -> float: ...

    @property
    def magnet_area(self) -> float: ...

    @property
    def magnet_length(self) -> float: ...

    @property
    def remanence(self) -> float: ...

    @property
    def recoil_permeability(self) -> float: ...

    @property
    def force_constant(self) -> float | None: ...

    @property
    def force_exponent(self) -> float | None: ...

    @property
    def force_length(self) -> float | None: ...

    @property
    def gap_offset(self) -> float: ...

    @property
    def flux_path(self) -> str:
        """Where the control flux closes: "gap" or "magnet"."""
        ...

    @property
    def bearings(self) -> int: ...

    @property
    def bias_current(self) -> float: ...

    @property
    def actuator_gain(self) -> float | None: ...

    @property
    def negative_stiffness(self) -> float | None: ...

    @property
    def coil_inductance(self) -> float | None: ...


@dataclass(frozen=True)
class MagnetKind:
    """One kind of magnet: everything that other modules need to know about it, in the file of its name.

    Args:
        law: gives the force law by a magnet's geometry alone, without calibration.
        check: raises ValueError that names the parameter which is missing, belongs to another kind, or does not carry
            the weight; ranges have been checked before.
        pull: piece of the kernel (x, k, y, current): acceleration of lane k by the magnet. Kinds may share one.
        shaped_pull: gives the piece for iron that saturates, or for another falloff with the gap, or both; for a
            knee of any sharpness (three bools); None if `pull` has all that can be simulated.
        pair: whether two opposed magnets pull on the rotor.
        inductance_follows_gap: whether the coil's inductance depends on the gap, so that the coil can sense it.
        balancing_bias: bias current (A) with which a single-sided magnet carries the weight at y = 0, i = 0; None for
            a pair.
        plain: whether `pull` has the force law of a magnet of this kind; otherwise `shaped_pull` has.
        own: parameters that it needs and not every kind has.
        optional: the same, but they may be left out. Giving a parameter of another kind is an error.
    """

    law: Callable[[Magnet], ForceLaw | SingleSidedLaw]
    check: Callable[[Magnet], None]
    pull: Callable[..., float]
    shaped_pull: Callable[[bool, bool, bool], Callable[..., float]] | None = None
    pair: bool = False
    inductance_follows_gap: bool = False
    balancing_bias: Callable[[Magnet], float] | None = None
    plain: Callable[[Magnet], bool] = lambda m: True
    own: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
