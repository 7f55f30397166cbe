"""A rig: the frozen physical parameters of a levitated rotor, checked."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from math import inf, pi, sqrt
from typing import Any

from maglev_env.channels import NOISY
from maglev_env.fields import (
    check_known,
    check_range,
    is_number,
    quantity,
)
from maglev_env.loop.axes import AXES, NO_CROSS, Cross
from maglev_env.loop.card import Need, Scales
from maglev_env.loop.effect import EFFECTS, FINER, NEEDS, Effects, check_effects
from maglev_env.loop.gains import Controllers, of_axis
from maglev_env.loop.magnets.kinds import KINDS, MAGNETS, NO_MAGNET, check_magnet, force_law
from maglev_env.loop.magnets.law import field_at_rest, linearise
from maglev_env.loop.self_sensor import SelfSensing
from maglev_env.presented import shown_as_table
from maglev_env.rig.excitation import axis_excitations
from maglev_env.rig.protocol import Protocol
from maglev_env.rig.target import Target, default_band
from maglev_env.units import STANDARD_GRAVITY
from maglev_lanes.price import check_length

FLUX_PATHS = ("gap", "magnet")
MOST_NOISE = 1e6  # rms of any channel, SI


@dataclass(frozen=True)
class Noise:
    """Rms per sample of the white noise on the readings.

    Args:
        displacement: m; this noise also enters the control loop.
        force: N.
        current: A.

    Raises:
        ValueError: A value is not a number or negative.
    """

    displacement: float = 0.0
    force: float = 0.0
    current: float = 0.0

    def __post_init__(self) -> None:
        for f in fields(self):
            v = getattr(self, f.name)
            if not (is_number(v) and 0 <= v <= MOST_NOISE):
                raise ValueError(f"[noise]: {f.name} = {v} must be a number from 0 to {MOST_NOISE:g}")


if apart := {f.name for f in fields(Noise)} ^ set(NOISY):
    raise ImportError(f"noise of {apart.pop()}: it stands in one of rig.Noise and the table of channels alone")


@dataclass(frozen=True)
class Rig:
    """Physical parameters of a levitated rotor, SI; each field's metadata has its unit and physical range.

    A rig with two axes has the same parameters in x and y except those in per_axis; its clearance is a circle.

    Args:
        name: for messages and reports.
        magnet: the kind of magnet, a name of `magnets.kinds.KINDS`, or "none".
        clearance: 0: that of the gap.
        turns: 1: not known; the force law of an electromagnet may be given otherwise (see `magnets.electromagnet`).
        force_constant: of a magnet_coil, N m^n/A, or an electromagnet, N m^n/A2.
        force_exponent: n of these.
        force_length: of an electromagnet.
        gap_offset: likewise.
        flux_path: where the control flux of a hybrid pair closes: "gap" or "magnet".
        bias_current: 0 for a single-sided magnet: the one that carries the weight.
        actuator_gain: measured df/di, which calibrates the magnet's force law; None: by geometry.
        negative_stiffness: measured -df/dy (< 0), likewise.
        adc_bits: 0: an ideal converter.
        dac_bits: likewise; where both are ideal, neither has a range.
        rounds: whether the converters round to these bits; False: they only limit.
        axes: 1, or 2 for x and y.
        per_axis: parameters that differ in axis "x" or "y".
        cross: coupling of the two axes.
        gains: one controller for both axes, or a pair; None: not given, see `defaults.with_defaults`.
        noise: of the readings.
        bounds: (low, high) of gains, for tuning.
        protocol: the identification experiment; None: not given.
        target: of the score.
        tolerance: relative 1-sigma uncertainty of parameters.
        randomization: (low, high) factors of parameters that are drawn wide.
        self_sensing: supply, acquisition and estimator of self-sensing.
        effects: beyond these parameters, in every experiment on the rig.

    Raises:
        ValueError: A value is not valid or does not fit the others; the message names it.
    """

    name: str
    magnet: str
    mass: float = quantity("kg", 1e-6, 1e5)
    support_stiffness: float = quantity("N/m", 0.0, 1e10, 0.0)
    support_damping: float = quantity("N s/m", 0.0, 1e7, 0.0)
    gap: float = quantity("m", 1e-6, 10.0, 1e-3)  # of a voice coil, the force of which hardly depends on its place
    clearance: float = quantity("m", 1e-7, 0.1, 0.0)
    turns: float = quantity("", 1.0, 1e5, 1.0)
    pole_area: float = quantity("m2", 1e-9, 1.0, 1e-4)
    magnet_area: float = quantity("m2", 1e-9, 1.0, 1e-4)
    magnet_length: float = quantity("m", 1e-6, 1.0, 1e-3)
    remanence: float = quantity("T", 0.0, 3.0, 0.0)
    recoil_permeability: float = quantity("mu_0", 0.5, 100.0, 1.05)
    force_constant: float | None = quantity("N m^n/A", 1e-60, 1e12, None)
    force_exponent: float | None = quantity("", 1.0, 10.0, None)
    force_length: float | None = quantity("m", 1e-6, 1.0, None)
    gap_offset: float = quantity("m", 0.0, 1.0, 0.0)
    flux_path: str = "gap"
    bearings: int = quantity("", 1, 16, 1)
    bias_current: float = quantity("A", 0.0, 1e3, 0.0)
    actuator_gain: float | None = quantity("N/A", 1e-6, 1e6, None)
    negative_stiffness: float | None = quantity("N/m", -1e9, 0.0, None)
    coil_inductance: float | None = quantity("H", 1e-9, 1e3, None)
    coil_resistance: float = quantity("ohm", 0.0, 1e4, 0.0)
    supply_voltage: float = quantity("V", 0.1, 1e5, 24.0)
    amplifier_gain: float = quantity("A/V", 1e-4, 1e4, 1.0)
    amplifier_time_constant: float = quantity("s", 0.0, 10.0, 0.0)
    sensor_time_constant: float = quantity("s", 0.0, 0.1, 0.0)
    probe_gain: float = quantity("V/m", 1e-3, 1e9, 8000.0)
    adc_bits: int = quantity("bit", 0, 32, 16)
    dac_bits: int = quantity("bit", 0, 32, 14)
    voltage_range: float = quantity("V", 0.1, 1e4, 10.0)
    rounds: bool = True
    control_rate: float = quantity("Hz", 1.0, 1e6, 20000.0)
    gravity: float = quantity("m/s2", 0.0, 100.0, STANDARD_GRAVITY)
    axes: int = 1
    per_axis: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    cross: Cross = NO_CROSS
    gains: Controllers | None = None
    noise: Noise = Noise()
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    protocol: Protocol | None = None
    target: Target = field(default_factory=Target)
    tolerance: Mapping[str, float] = field(default_factory=dict)
    randomization: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    self_sensing: SelfSensing = field(default_factory=SelfSensing)
    effects: Effects = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.magnet not in MAGNETS:
            raise ValueError(f"magnet = {self.magnet!r}; use one of {', '.join(MAGNETS)}")
        if self.flux_path not in FLUX_PATHS:
            raise ValueError(f"flux_path = {self.flux_path!r}; use one of {', '.join(FLUX_PATHS)}")
        if not isinstance(self.name, str) or not self.name:
            raise ValueError(f"name = {self.name!r} must be a text")
        if type(self.axes) is not int or self.axes not in (1, 2):
            raise ValueError(f"axes = {self.axes!r}; use 1, or 2 for x and y")
        if self.axes == 1 and (self.per_axis or self.cross != NO_CROSS or isinstance(self.gains, tuple)):
            raise ValueError("[axis], [cross] and gains per axis need axes = 2")
        if self.axes == 1 and self.protocol and any(e.components[1] for e in self.protocol.excitations):
            raise ValueError("[protocol]: an excitation's direction needs axes = 2")
        self._check_protocol()
        if isinstance(self.gains, tuple) and len(self.gains) != 2:
            raise ValueError(f"gains: {len(self.gains)} controllers; give one for both axes, or one for each")
        for axis, own in self.per_axis.items():
            check_known((axis,), AXES, "[axis]")
            if not isinstance(own, Mapping):
                raise ValueError(f"[axis.{axis}] = {own!r} must be a table")
            for key in own:
                check_known((key,), _PER_AXIS, f"[axis.{axis}]")
        if not self.clearance:
            object.__setattr__(self, "clearance", self.gap)
        for f in fields(self):
            if f.metadata:
                check_range(f.name, getattr(self, f.name), f.metadata)
        if self.clearance > self.gap:
            raise ValueError(f"clearance = {self.clearance} m is larger than the gap {self.gap} m: state both")
        for axis, name in enumerate(AXES if self.per_axis else ()):
            try:  # an axis' own parameters are checked like the common ones
                _one_axis(self, axis)
            except ValueError as error:
                raise ValueError(f"[axis.{name}]: {error}") from None
        check_magnet(self)
        if self.target.band is None:
            object.__setattr__(self, "target", replace(self.target, band=default_band_of(self)))
        check_effects(self.effects, self, FINER)  # a recording may be simulated at a finer rate

    def __repr__(self) -> str:
        axes = "" if self.axes == 1 else ", x and y"
        effects = f", with {', '.join(self.effects)}" if self.effects else ""
        return f"<Rig {self.name}: {self.magnet}{axes}, {self.mass:g} kg, {self.control_rate:g} Hz{effects}>"

    def _repr_html_(self) -> str:
        stated = [(f, getattr(self, f.name)) for f in fields(self) if f.metadata]
        return shown_as_table(
            self, [(f.name, f"{v:g} {f.metadata['unit']}") for f, v in stated if v is not None and v != f.default]
        )

    def _check_protocol(self) -> None:
        """Refuse an experiment of a length that nobody can have meant."""
        p = self.protocol
        if p is None or not is_number(self.control_rate):
            return
        for e in p.excitations:
            if e.periodic:
                check_length(self.control_rate / e.fundamental, p.periods + p.transient_periods, "[protocol]")

    @property
    def runs_away(self) -> bool:
        """Whether nothing but the controller holds the rotor: the magnet's pull grows faster than the support's."""
        return self.controlled and linearise(force_law(self))[1] + self.support_stiffness < 0

    @property
    def controlled(self) -> bool:
        """Whether the rig has an actuator for a controller to use."""
        return self.magnet != NO_MAGNET

    @property
    def reading_step(self) -> float:
        """Step of the converter that reads the displacement, m; 0 of one that does not round."""
        return 2 * self.voltage_range / 2**self.adc_bits / self.probe_gain if self.adc_bits else 0.0

    @property
    def command_step(self) -> float:
        """Step of the converter that gives the command, A; 0 of one that does not round."""
        return 2 * self.voltage_range * self.amplifier_gain / 2**self.dac_bits if self.dac_bits else 0.0

    @cached_property
    def by_axis(self) -> tuple["Rig", ...]:
        """See `axis_rig`."""
        return (self,) if self.axes == 1 else (_one_axis(self, 0), _one_axis(self, 1))

    @cached_property
    def scales(self) -> Scales:
        """What the bounds of effects are in proportion to."""
        kind = KINDS.get(self.magnet)
        rest = abs(self.bias_current or kind.balancing_bias(self)) if kind and kind.balancing_bias else 0.0
        lacks = frozenset(NEEDS) - self.capabilities
        bias, field = self.bias_current or rest or inf, 1.0
        if "pair" in self.capabilities:  # what a permanent magnet does beside it counts, too
            law = force_law(self.by_axis[0])
            gain, stiffness = linearise(law)
            bias = max(self.bias_current, abs(stiffness) * self.gap / gain)
            field = field_at_rest(law)
        return Scales(1 / self.control_rate, self.mass, bias, rest, field, lacks)

    @cached_property
    def capabilities(self) -> frozenset[Need]:
        """The needs of effects that this rig fulfils, see `loop.effect.NEEDS`."""
        stated: dict[Need, bool] = {
            "magnets": self.controlled,
            "pair": self.controlled and KINDS[self.magnet].pair,
            "iron": self.controlled and not KINDS[self.magnet].pair and KINDS[self.magnet].inductance_follows_gap,
            "yoke": self.controlled and KINDS[self.magnet].inductance_follows_gap,
            "two_axes": self.axes == 2,
            "coil": self.controlled and self.coil_inductance is not None,
            "support": self.support_stiffness > 0,
        }
        return frozenset(need for need, has in stated.items() if has)


PARAMETERS: Mapping[str, Mapping[str, Any]] = {
    f.name: f.metadata or {"unit": "", "low": -inf, "high": inf}
    for f in fields(Rig)
    if f.metadata or f.name == "flux_path"
}


# Parameters that [axis.x] and [axis.y] may override: all except those of the common bore, controller board and magnet.
_COMMON = ("control_rate", "clearance", "gravity", "flux_path", "adc_bits", "dac_bits")
_PER_AXIS = [name for name in PARAMETERS if name not in _COMMON]


def with_parameters(rig: Rig, parameters: Mapping[str, Any]) -> Rig:
    """The rig with some physical parameters replaced.

    A clearance that equals the gap follows a new gap, and a default target band a new control rate.

    Raises:
        ValueError: A parameter is unknown or outside its physical range; the message names it.
    """
    check_known(parameters, PARAMETERS, "[parameters]")
    if "gap" in parameters and "clearance" not in parameters and rig.clearance == rig.gap:
        parameters = {**parameters, "clearance": parameters["gap"]}
    # A default band follows the control rate alone: rigs within tolerance of one another are judged in one band.
    if "control_rate" in parameters and rig.target.band == default_band_of(rig):
        parameters = {**parameters, "target": replace(rig.target, band=None)}
    return replace(rig, **parameters)


def with_parameters_of_all_axes(rig: Rig, parameters: Mapping[str, Any]) -> Rig:
    """As `with_parameters`, also of axes that have values of their own.

    Raises:
        ValueError: As `with_parameters`.
    """
    own = {axis: {n: v for n, v in values.items() if n not in parameters} for axis, values in rig.per_axis.items()}
    return with_parameters(replace(rig, per_axis=own), parameters)


def default_band_of(rig: Rig) -> tuple[float, float]:
    """`default_band` of a rig, whose default gains give it the magnet's own stiffness, with the other sign."""
    if rig.magnet == NO_MAGNET:
        return default_band(rig.control_rate)
    stiffness = abs(linearise(force_law(rig))[1]) + rig.support_stiffness
    return default_band(rig.control_rate, sqrt(stiffness / rig.mass) / (2 * pi) if stiffness else inf)


def axis_rig(rig: Rig, axis: int) -> Rig:
    """Axis 0 (x) or 1 (y) of a rig as an uncoupled one-axis rig with its own parameters and controller.

    Its protocol has the components of the excitations along this axis.
    """
    return rig if rig.axes == 1 else rig.by_axis[axis]


def _one_axis(rig: Rig, axis: int) -> Rig:
    gains, protocol = rig.gains and of_axis(rig.gains, axis), rig.protocol
    if protocol:
        protocol = replace(protocol, excitations=axis_excitations(protocol.excitations, axis))
    effects = {name: values for name, values in rig.effects.items() if "two_axes" not in EFFECTS[name].needs}
    own = replace(rig, axes=1, per_axis={}, cross=NO_CROSS, gains=gains, protocol=protocol, effects=effects)
    parameters = rig.per_axis.get(AXES[axis], {})
    return with_parameters(own, parameters) if parameters else own
