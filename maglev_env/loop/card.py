"""The card of an effect: everything that other modules need to know about it, in the file of its block.

A new effect is a card, its states and its compiled piece in one block's file, and a form in the sealed twin
(`sim2real.blind`), which shares no code with the simulator on purpose.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Literal

Block = Literal["sensor", "controller", "amplifier", "actuator", "mechanics", "external"]
Need = Literal["magnets", "pair", "iron", "yoke", "two_axes", "coil", "support"]
Per = Literal["", "control period", "mass / control period", "field at rest"]


@dataclass(frozen=True)
class Scales:
    """What sizes of effects are in proportion to on a rig: a lag that is small at 100 Hz is huge at 20 kHz.

    Args:
        period: control period, s.
        mass: moving mass, kg.
        bias: size of the bias current, A; of a pair, with that which makes the field of its permanent magnets, |k| gap
            / gain; of a single magnet that states none, that which carries the weight; infinite without magnets.
        rest: size of the current with which a single magnet carries the weight, A; 0 of a pair.
        field: flux density in the gaps of a pair at rest, T; 1 where there is no pair.
        lacks: which needs the rig does not fulfil.
        motion: largest displacement from the mean in what is fitted, m; 0 where nothing is known of it.
    """

    period: float
    mass: float
    bias: float = inf
    rest: float = 0.0
    field: float = 1.0
    lacks: frozenset[Need] = frozenset()
    motion: float = 0.0

    def wider(self, factor: float) -> "Scales":
        """Scales whose units are all larger by a factor."""
        return replace(self, period=self.period * factor, mass=self.mass * factor**2)

    def of(self, per: Per) -> float:
        """Unit, in SI, of numbers that are stated per this."""
        units: Mapping[Per, float] = {
            "": 1.0,
            "control period": self.period,
            "mass / control period": self.mass / self.period,
            "field at rest": self.field,
        }
        return units[per]


SMALL_ROTOR = Scales(5e-5, 0.08012)  # 80 g at 20 kHz
SLOWEST = Scales(1.0, inf)  # no rig is slower: what is beyond its bounds is so on every rig


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Args:
        unit: SI unit, empty for a share.
        low, high: bounds.
        default: value when the user gives none; None for the first parameter, which must be given.
        absent: value with which the effect changes nothing.
        scale: value at which the effect is clearly visible on a small rotor; the unit of a fit's steps. None: a fit
            varies the logarithm of the parameter.
        starts: values at which a fit may start. Every combination of the parameters' starts is tried, and the best
            ones are refined.
        per: what bounds, scale, starts and shape are multiples of; see `on`. Empty: they are in SI.
        starts_per: what starts alone are multiples of.
        shape: the parameter is a coordinate of the effect's form: real effects differ in it, and the default is the
            plain formula. A fit frees it only where the plain formula leaves something, with this prior standard
            deviation: of its logarithm; with a default of 0 or a scale, of the value; with an infinite default, of its
            reciprocal, and a fit of the effect may also begin at its starts, with all else at the upper bounds. None:
            not a coordinate of the form.
        centre: value at which the prior of a form is centred, where that is not the default.
        within_bias: a fit keeps its size below the bias current of the rig.
        in_proportion: what the effect does is in proportion to it, although a fit varies its logarithm.
        of_motion: a fit keeps it above this share of the largest motion.
        sought: how far a fit goes, where that is less than the upper bound.
        beyond_rest: a fit keeps it above the current with which a single magnet carries the weight, and the prior of
            its reciprocal is as wide as that allows.
        needs: what a rig must have for this parameter to mean anything, beside what its effect needs.
        added: of something that the form adds, such as a further mode. One such parameter is its size, 0 by default,
            with a scale; a fit seeks where it lies at all combinations of the starts of the others.
        apart_from: effects beside which it is not simulated.
    """

    unit: str
    low: float
    high: float
    default: float | None = None
    absent: float = 0.0
    scale: float | None = None
    starts: tuple[float, ...] = ()
    per: Per = ""
    starts_per: Per = ""
    shape: float | None = None
    centre: float | None = None
    within_bias: bool = False
    in_proportion: bool = False
    of_motion: float = 0.0
    sought: float = inf
    beyond_rest: bool = False
    needs: tuple[Need, ...] = ()
    added: bool = False
    apart_from: tuple[str, ...] = ()

    def is_meant_on(self, scales: Scales) -> bool:
        """Whether the rig of these scales has what the parameter needs."""
        return scales.lacks.isdisjoint(self.needs)

    def range_on(self, scales: Scales) -> tuple[float, float]:
        """The bounds in SI on a rig of these scales."""
        unit = scales.of(self.per)
        # A unit may be infinite.
        return self.low * unit if self.low else 0.0, self.high * unit if self.high else 0.0

    def on(self, scales: Scales) -> "Parameter":
        """The parameter with bounds, scale and starts in SI on a rig of these scales."""
        if not self.per and not self.starts_per:
            return self
        unit = scales.of(self.per)
        scale = None if self.scale is None else self.scale * unit
        starts = tuple(start * scales.of(self.starts_per or self.per) for start in self.starts)
        shape = None if self.shape is None else self.shape * unit
        low, high = self.range_on(scales)
        return replace(self, low=low, high=high, scale=scale, starts=starts, shape=shape, per="", starts_per="")

    @property
    def bounds(self) -> str:
        """The bounds in words: "0 .. 20 control periods (s)", "-0.9 .. 9"."""
        plural = "s" if self.per == "control period" else ""
        unit = f"{self.per}{plural} ({self.unit})" if self.per else self.unit
        return f"{self.low:g} .. {self.high:g} {unit}".strip()


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
        linear: whether a diagnosis may compute it with the linearised loop.
        resonance: whether it is a mode whose frequency must be searched for.
        nominal: the rig parameter that the effect changes by a relative amount; a deviation within that parameter's
            tolerance is then a small effect.
        describes: whether its name says how a force goes with displacement, velocity or current, and not what makes it
            do so: a cause that no card describes may well have the same law.
        like: the effect that it resembles while the motion is small. There, neither is more likely than the other,
            however many parameters they have, and where one of them explains the other one is tried.
        form_share: the formula of a real effect may differ from the one here. Share of the explained sim-to-real gap
            that may remain for this reason when its form has been fitted; three times as much is not held against it.
            Told on campaigns in textbook forms (tests/tools/other_forms.py, and the benchmark's): of large gaps these
            left 0 to 1.6 %, of hysteresis 6 %, of a voltage limit 5 %.
        dither: whether sensor noise smooths it, so that it is simulated with noise and averaged: "always", "maybe"
            (both ways are tried) or "never".
        not_fitted: why a diagnosis does not fit it on spectral lines; empty if it does.
        left_alone: parameters that no fit varies; they keep their defaults.
        not_sealed: why the sealed check has no rig with it; empty if it has one.
        plain_kernel: coordinates of its form that every kernel simulates; the others need the shaped one.
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
    describes: bool = False
    like: str | None = None
    form_share: float = 0.0
    dither: Literal["never", "maybe", "always"] = "never"
    not_fitted: str = ""
    left_alone: tuple[str, ...] = ()
    not_sealed: str = ""
    plain_kernel: tuple[str, ...] = ()

    @property
    def plain(self) -> Mapping[str, Parameter]:
        """The parameters that every fit varies: without those of its form, and without those that are left alone."""
        return {key: p for key, p in self.parameters.items() if p.shape is None and key not in self.left_alone}

    @property
    def shapes(self) -> Mapping[str, Parameter]:
        """The parameters of its form."""
        return {key: p for key, p in self.parameters.items() if p.shape is not None}


def relative(starts: tuple[float, ...]) -> dict[str, Parameter]:
    """The parameter of an effect that changes a nominal value by a relative amount."""
    return {"change": Parameter("", -0.9, 9.0, scale=0.1, starts=starts)}


def first_order() -> dict[str, Parameter]:
    """The parameter of an additional first-order lag."""
    return {"time_constant": Parameter("s", 0.0, 200.0, scale=0.2, starts=(0.2, 2.0), per="control period")}


def phase() -> Parameter:
    """The phase of a tone at the start of a recording."""
    return Parameter("rad", -7.0, 7.0, 0.0)


def decay() -> Parameter:
    """Ratio of the amplitudes of successive harmonics of a tone; a tone has three harmonics."""
    return Parameter("", 0.0, 0.9, 0.0)
