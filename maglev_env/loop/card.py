"""The card of an effect: all that other modules need to know about it, in the file of its block.

A new effect is a card, its states and its compiled piece in one block's file, and a form in the sealed twin
(`sim2real.blind`), which shares no code with the simulator on purpose.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Block = Literal["sensor", "controller", "amplifier", "actuator", "mechanics", "external"]
Need = Literal["magnets", "pair", "two_axes", "coil", "support"]


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Args:
        unit: SI unit, empty for a share.
        low, high: bounds.
        default: value when the user gives none; None for the first parameter, which must be given.
        absent: value with which the effect does nothing.
        scale: size at which the effect is plain on a small rotor; the unit of a fit's steps. None: a fit moves the
            logarithm of the parameter.
        starts: values at which a fit may start. Every combination of the parameters' starts is tried in a lane, and
            the best are followed.
    """

    unit: str
    low: float
    high: float
    default: float | None = None
    absent: float = 0.0
    scale: float | None = None
    starts: tuple[float, ...] = ()


@dataclass(frozen=True)
class EffectCard:
    """One physical effect beyond the nominal rig.

    Args:
        block: where in the loop it sits.
        parameters: by name; a bare value on the command line sets the first.
        source: the formula and where it comes from.
        identified_by: the recorded channels that distinguish it from similar effects.
        needs: what a rig must have for the effect to mean anything, see `loop.effect.NEEDS`.
        flexible: whether only the flexible kernel simulates it; the plain one leaves it out for speed.
        linear: whether a linear loop stands for it in a diagnosis.
        resonance: whether it is a mode whose frequency must be searched for.
        nominal: the rig parameter whose relative change the effect is, so that a tolerance of that parameter is a
            small effect.
        form_share: share of the gap that it explains which remains, at most, when the true effect follows another
            formula of the same name.
        dither: whether sensor noise smooths it, so that it is simulated with noise and averaged: "always", "maybe"
            (both ways are tried) or "never".
        not_fitted: why a diagnosis does not fit it on spectral lines; empty where it does.
        not_sealed: why the sealed check has no rig with it; empty where it has.
    """

    block: Block
    parameters: Mapping[str, Parameter]
    source: str
    identified_by: str
    needs: tuple[Need, ...] = ()
    flexible: bool = False
    linear: bool = True
    resonance: bool = False
    nominal: str | None = None
    form_share: float = 0.0
    dither: Literal["never", "maybe", "always"] = "never"
    not_fitted: str = ""
    not_sealed: str = ""


def relative(starts: tuple[float, ...]) -> dict[str, Parameter]:
    """The parameter of an effect that changes a nominal value in proportion."""
    return {"change": Parameter("", -0.9, 9.0, scale=0.1, starts=starts)}


def first_order(starts: tuple[float, ...] = (1e-5, 1e-4)) -> dict[str, Parameter]:
    """The parameter of one more first-order lag."""
    return {"time_constant": Parameter("s", 0.0, 0.01, scale=1e-5, starts=starts)}


def phase() -> Parameter:
    """The phase of a tone at the start of a recording."""
    return Parameter("rad", -7.0, 7.0, 0.0)


def decay() -> Parameter:
    """Amplitude of each further harmonic of a tone over the one before it; there are three in all."""
    return Parameter("", 0.0, 0.9, 0.0)
