"""An experiment: a rig with effects and gains, its excitations and duration, and the seed of its noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf

import numpy as np

from maglev_env.channels import MEASURED, SENSORS, SPECTRAL, simulated_channels
from maglev_env.fields import is_number
from maglev_env.loop.axes import suffixes
from maglev_env.loop.effect import EFFECTS, FINER, NO_EFFECTS, Effects, check_effects, effect_value
from maglev_env.loop.gains import NO_CONTROLLER, Controller, Controllers, of_axis, reads_current
from maglev_env.rig.excitation import Excitation, axis_excitations, check_interleaved
from maglev_env.rig.rig import Rig, axis_rig
from maglev_env.rig.self_sensor import check_in_loop, rig_sensors
from selfsense.sensor import SelfSensor


@dataclass(frozen=True)
class Experiment:
    """Everything that determines a simulated record.

    Args:
        rig: the rig.
        gains: its controllers.
        excitations: periodic, on different lines of one fundamental; may be empty if only linear responses are needed.
        periods: number of periods that are kept.
        transient_periods: number of periods before them that are dropped.
        effects: beyond the nominal rig. The rig's own effects are added, except those of the same name; they stay when
            `replace` changes the rig.
        offset: static reference, m, in x on an x-y rig.
        seed: of the noise of all channels.
        sample_rate: of the recording, Hz: an integer multiple or fraction of the control rate; None: the control rate.
        sensor: "probe", "self_sensing" by the rig's own coils (see `loop.self_sensor`), or a self-sensor for each axis.
        speed_rpm: speed of rotation, 1/min.
        apart: effect that changes a nominal parameter -> how much larger that is along y than along x, as a share,
            within the bounds of the effect.

    Raises:
        ValueError: A value is not valid, or the parts do not fit together; the message says which.
    """

    rig: Rig
    gains: Controllers
    excitations: tuple[Excitation, ...]
    periods: int = 5
    transient_periods: int = 1
    effects: Effects = field(default_factory=lambda: NO_EFFECTS)
    offset: float = 0.0
    seed: int | tuple[int, ...] = 0
    sample_rate: float | None = None
    sensor: str | tuple[SelfSensor, ...] = "probe"
    speed_rpm: float = 0.0
    apart: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        effects = f", with {', '.join(self.effects)}" if self.effects else ""
        return f"<Experiment on {self.rig.name}: {self.gains!r}{effects}, {self.periods} periods, seed {self.seed}>"

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", {**self.rig.effects, **self.effects})
        check_effects(self.effects, self.rig, FINER)
        if not is_number(self.speed_rpm) or self.speed_rpm < 0:
            raise ValueError(f"experiment: speed_rpm = {self.speed_rpm!r} must be a number, at least 0")
        self._check_sensor()
        for gains in self.gains if isinstance(self.gains, tuple) else (self.gains,):
            if not isinstance(gains, Controller) and (gains is not None or self.rig.controlled):
                raise ValueError(
                    f"experiment: gains = {gains!r}; give Gains(kp=..., ki=..., kd=...), or one for each axis"
                )
        check_interleaved(self.excitations)
        if not self.rig.controlled and any(e.at != "force" for e in self.excitations):
            raise ValueError(f"experiment: rig {self.rig.name} has no magnets: only a force can excite it")
        if self.rig.axes == 1 and isinstance(self.gains, tuple):
            raise ValueError(f"experiment: rig {self.rig.name} has one axis; give one controller")
        if isinstance(self.gains, tuple) and len(self.gains) != 2:
            raise ValueError(f"experiment: {len(self.gains)} controllers; give one for both axes, or one for each")
        self._check_current()
        if self.rig.axes == 1 and any(e.direction and e.components[1] for e in self.excitations):
            raise ValueError(
                f"experiment: rig {self.rig.name} has one axis: a direction is 0, or 180 degrees to act against it"
            )
        self._check_apart()
        if self.sample_rate is not None and (isinstance(self.sample_rate, bool) or not 0 < self.sample_rate < inf):
            raise ValueError(f"experiment: sample_rate = {self.sample_rate!r} Hz must be a positive number")
        sampling(self.recorded_rate, self.rig.control_rate)
        for e in self.excitations:
            if e.periodic and 2 * e.frequencies[-1] >= self.recorded_rate:
                raise ValueError(
                    f"experiment: line {e.lines[-1]} ({e.frequencies[-1]:g} Hz) is not below half of the recorded "
                    f"{self.recorded_rate:g} Hz: it would fold back; sample faster, or leave the line out"
                )
        if self.periods < 1 or self.transient_periods < 0:
            raise ValueError("experiment: periods must be at least 1 and transient_periods at least 0")
        if self.offset and abs(self.offset) >= self.rig.clearance:
            raise ValueError(f"experiment: offset {self.offset} m is beyond the clearance {self.rig.clearance} m")

    def _check_apart(self) -> None:
        for name, more in self.apart.items():
            changing = [own for own, card in EFFECTS.items() if card.nominal]
            if self.rig.axes == 1 or name not in changing or not is_number(more):
                raise ValueError(
                    f"experiment: apart = {{{name!r}: {more!r}}}; of a rig with two axes, give by which share one of "
                    f"{', '.join(changing)} is larger along y than along x"
                )

    def _check_current(self) -> None:
        if not self.rig.controlled or not reads_current(self.gains, 1 / self.rig.control_rate):
            return
        if any(axis_rig(self.rig, axis).amplifier_time_constant == 0 for axis in range(self.rig.axes)):
            raise ValueError(
                f"experiment: the controller reads the coil's current, but rig {self.rig.name} has "
                "amplifier_time_constant = 0, so that the current is the command itself; give the time constant: of a "
                "coil at a voltage L / R"
            )

    def _check_sensor(self) -> None:
        if isinstance(self.sensor, tuple):
            if len(self.sensor) != self.rig.axes or not all(isinstance(s, SelfSensor) for s in self.sensor):
                raise ValueError(f"sensor: {len(self.sensor)} self-sensors; give one SelfSensor for each axis")
            if not self.rig.controlled:
                raise ValueError(f"sensor: rig {self.rig.name} has no magnets and so no coils to sense with; use probe")
        elif not isinstance(self.sensor, str) or self.sensor not in SENSORS:
            raise ValueError(
                f"sensor = {str(self.sensor)[:40]!r}; use {' or '.join(SENSORS)}, or a tuple with a SelfSensor for "
                "each axis"
            )
        if self.sensor == "probe":
            return
        for name in ("sensor_gain", "sensor_lag", "sensor_resonance", "runout", "pickup", "probe_backlash"):
            if name in self.effects:
                raise ValueError(f"effect {name} is the probe's: it has no meaning with self-sensing; leave it out")
        for sensor in self_sensors(self):
            check_in_loop(sensor)

    @cached_property
    def by_axis(self) -> tuple["Experiment", ...]:
        """See `axis_experiment`."""
        return (self,) if self.rig.axes == 1 else (_one_axis(self, 0), _one_axis(self, 1))

    @property
    def fundamental(self) -> float:
        return self._periodic.fundamental

    @property
    def samples_per_period(self) -> int:
        """Control samples in a period."""
        return self._periodic.samples_per_period(self.rig.control_rate)

    @property
    def recorded_per_period(self) -> int:
        """Samples of the recording in a period."""
        return self._periodic.samples_per_period(self.recorded_rate)

    @property
    def _periodic(self) -> Excitation:
        for e in self.excitations:
            if e.periodic:
                return e
        raise ValueError("experiment: give at least one periodic excitation (sphs, multisine, low_crest or impulse)")

    @property
    def recorded_rate(self) -> float:
        """Samples per second of the recording."""
        return self.sample_rate or self.rig.control_rate

    def waveform(self, place: str) -> np.ndarray:
        """One period of the excitation at a place, zeros without one.

        Args:
            place: "force" (N), "current" (A) or "reference" (m, without the offset).

        Returns:
            At the control rate, (samples_per_period,), or (2, samples_per_period) on an x-y rig.
        """
        total = np.zeros((self.rig.axes, self.samples_per_period))
        for e in self.excitations:
            if e.periodic and e.at == place:
                total += e.components[: self.rig.axes, None] * e.waveform(self.rig.control_rate)
        return total if self.rig.axes == 2 else total[0]


def self_sensors(e: Experiment) -> tuple[SelfSensor, ...]:
    """The self-sensor of each axis; empty with a probe.

    Raises:
        ValueError: The rig's coils cannot sense the gap.
    """
    if e.sensor == "probe":
        return ()
    return e.sensor if isinstance(e.sensor, tuple) else rig_sensors(e.rig)


def spectral_channels(e: Experiment) -> tuple[str, ...]:
    """SPECTRAL channels of an experiment; with self-sensing also the true position."""
    return channels_of(e.rig, (*SPECTRAL, *(("position",) if e.sensor != "probe" else ())))


def recorded_channels(e: Experiment) -> tuple[str, ...]:
    """Channels of an experiment's records; with self-sensing also the true position."""
    return simulated_channels(sensed=e.sensor != "probe")


def channels_of(rig: Rig, names: Sequence[str] = MEASURED) -> tuple[str, ...]:
    """Names of a rig's channels, on an x-y rig with the suffix of each axis: displacement_x, displacement_y, ..."""
    return tuple(name + suffix for name in names for suffix in suffixes(rig.axes))


def sampling(sample_rate: float, control_rate: float) -> tuple[int, int]:
    """Ratio of the recorded rate and the control rate (Hz).

    Returns:
        Recorded samples per control sample, and control samples per recorded sample; one of the two is 1.

    Raises:
        ValueError: The ratio of the rates is not an integer or one over an integer.
    """
    for ratio, pair in ((sample_rate / control_rate, (1, 0)), (control_rate / sample_rate, (0, 1))):
        if ratio > 1 - 1e-9 and abs(ratio - round(ratio)) < 1e-9 * ratio:
            return max(1, round(ratio) * pair[0]), max(1, round(ratio) * pair[1])
    raise ValueError(
        f"sample_rate = {sample_rate:g} Hz is neither a multiple nor an integer fraction of control_rate = "
        f"{control_rate:g} Hz"
    )


# Mixed into the seed so that the two axes have different noise; users are unlikely to choose these numbers as seeds.
_AXIS_SEEDS = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F)


def axis_experiment(e: Experiment, axis: int) -> Experiment:
    """One axis of an experiment, with its rig, controller and seed, and the excitations' components along it.

    Args:
        e: the experiment; returned unchanged if it has one axis.
        axis: 0 (x) or 1 (y).
    """
    return e if e.rig.axes == 1 else e.by_axis[axis]


def _one_axis(e: Experiment, axis: int) -> Experiment:
    own, gains = axis_excitations(e.excitations, axis), of_axis(e.gains, axis)
    offset = e.offset if axis == 0 else 0.0
    sensor = e.sensor[axis : axis + 1] if isinstance(e.sensor, tuple) else e.sensor
    rig = axis_rig(e.rig, axis)
    effects = {name: values for name, values in e.effects.items() if "two_axes" not in EFFECTS[name].needs}
    for name, more in e.apart.items():
        changed, bounds = (1 + effect_value(effects, name)) * (1 + (axis - 0.5) * more) - 1, EFFECTS[name].parameters
        possible = min(max(changed, bounds["change"].low), bounds["change"].high)
        effects[name] = {**effects.get(name, {}), "change": possible}
    return replace(
        e,
        rig=rig,
        gains=gains,
        excitations=own,
        effects=effects,
        seed=axis_seed(e, axis),
        offset=offset,
        sensor=sensor,
        apart={},
    )


def axis_seed(e: Experiment, axis: int) -> int | tuple[int, ...]:
    """Seed of the noise of one axis."""
    if e.rig.axes == 1:
        return e.seed
    return (*(e.seed if isinstance(e.seed, tuple) else (e.seed,)), _AXIS_SEEDS[axis])


def protocol_experiment(
    rig: Rig,
    gains: Controllers | None = None,
    effects: Effects = NO_EFFECTS,
    seed: int | tuple[int, ...] = 0,
    sensor: str | tuple[SelfSensor, ...] = "probe",
) -> Experiment:
    """The rig's own protocol as an experiment.

    Args:
        rig: with a protocol.
        gains: default: the rig's preset gains.
        effects: as in `Experiment`.
        seed: likewise.
        sensor: likewise.

    Raises:
        ValueError: The rig has no protocol, or it has magnets but no gains; `defaults.with_defaults` adds them.
    """
    p, gains = rig.protocol, gains or rig.gains or (None if rig.controlled else NO_CONTROLLER)
    if p is None or gains is None:
        lacks = "gains" if p else "protocol"
        raise ValueError(f"rig {rig.name}: its TOML has no [{lacks}]; fill it in by with_defaults(rig)")
    return Experiment(rig, gains, p.excitations, p.periods, p.transient_periods, effects, seed=seed, sensor=sensor)


def without_noise(experiment: Experiment) -> Experiment:
    """The experiment without noise, and with converters that limit and do not round."""
    quiet = replace(experiment.rig.noise, displacement=0.0, force=0.0, current=0.0)
    sensing = replace(experiment.rig.self_sensing, adc_bits=0)
    rig = replace(experiment.rig, noise=quiet, rounds=False, self_sensing=sensing)
    sensor = experiment.sensor
    if isinstance(sensor, tuple):
        sensor = tuple(replace(s, acquisition=replace(s.acquisition, bits=0, noise=0.0)) for s in sensor)
    return replace(experiment, rig=rig, sensor=sensor)
