"""A self-sensor: coil, supply, acquisition and parameter estimator, and the values that the lane kernel needs."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from math import inf

import numpy as np

from maglev_lanes.layout import LaneRows
from selfsense import kernel_rows as k
from selfsense.coil import Coil, is_number
from selfsense.forward_path import DigitalPath, ForwardPath
from selfsense.kernel_pieces import SensorStructure
from selfsense.supply import Acquisition, Supply, check_rates

LARGEST_DECAY = 0.3  # per sample; up to this the kernel's series of e^-x is accurate to 1e-5


@dataclass(frozen=True)
class Estimator:
    """The parameter estimator of Maslen, Noh and Montie: its assumed coil and supply, and its PI gains.

    A simulated inductor receives the same switching voltage, two identical forward paths compare its ripple with the
    coil's, and a PI controller moves the estimated gap until they agree. `design.design_pi` finds gains.

    Attributes:
        coil: Assumed coil.
        voltage: Assumed supply voltage, V.
        kp: m/A.
        ki: m/(A s).
        gap_range: Smallest and largest estimated gap, m.
        path: Forward path.

    Raises:
        ValueError: A value is out of range, or the assumed coil has core losses.
    """

    coil: Coil
    voltage: float
    kp: float
    ki: float
    gap_range: tuple[float, float]
    path: ForwardPath = field(default_factory=DigitalPath)

    def __post_init__(self) -> None:
        if not (is_number(self.voltage) and self.voltage > 0):
            raise ValueError(f"estimator: voltage = {self.voltage!r} V must be a positive number")
        for name in ("kp", "ki"):
            value = getattr(self, name)
            if not (is_number(value) and value >= 0):
                raise ValueError(f"estimator: {name} = {value!r} must be a number of at least 0")
        if not (
            isinstance(self.gap_range, tuple | list)
            and len(self.gap_range) == 2
            and all(map(is_number, self.gap_range))
            and self.gap_range[1] > self.gap_range[0] >= 0
            and self.gap_range[0] + self.coil.core_length > 0
        ):
            raise ValueError(f"estimator: gap_range = {self.gap_range!r} m must be two rising gaps above 0")
        object.__setattr__(self, "gap_range", tuple(self.gap_range))  # so that a sensor can be the key of a cache
        if not isinstance(self.path, ForwardPath):
            raise ValueError(f"estimator: path = {self.path!r}; use a DigitalPath or an AnalogPath")
        if self.coil.has_core_losses:
            raise ValueError(
                "estimator: the simulated inductor knows no eddy currents and no saturation; leave them out"
            )


@dataclass(frozen=True)
class SelfSensor:
    """A real coil, its supply and acquisition, and the estimator that reads the gap from its current.

    The displacement is scale (gap - estimate) + shift (m); scale and shift come from a static calibration.

    Attributes:
        coil: The real coil.
        supply: Its supply.
        acquisition: How current and voltage are read.
        estimator: The estimator.
        gap: At rest, m, where estimate and displacement begin.
        scale: Dimensionless.
        shift: m.

    Raises:
        ValueError: The parts do not fit together.
    """

    coil: Coil
    supply: Supply
    acquisition: Acquisition
    estimator: Estimator
    gap: float
    scale: float = 1.0
    shift: float = 0.0

    def __post_init__(self) -> None:
        check_rates(self.supply, self.acquisition)
        low, high = self.estimator.gap_range
        if not (is_number(self.gap) and low < self.gap < high):
            raise ValueError(f"self-sensor: gap = {self.gap!r} m is not inside the estimator's {low} .. {high} m")
        for name in ("scale", "shift"):
            if not is_number(getattr(self, name)):
                raise ValueError(f"self-sensor: {name} = {getattr(self, name)!r} is not a finite number; calibrate it")
        samples_and_periods(self)
        self.estimator.path.sections(self.acquisition.rate)
        for name, coil in (("coil", self.coil), ("estimator", self.estimator.coil)):
            decay = coil.resistance / coil.inductance(high) / self.acquisition.rate
            if decay > LARGEST_DECAY:
                raise ValueError(
                    f"self-sensor: the {name}'s current decays by e^-{decay:.2g} within one sample; at most "
                    f"e^-{LARGEST_DECAY} can be followed: sample faster, or correct resistance and gap_range"
                )


def largest_gap(sensor: SelfSensor) -> float:
    """Largest gap (m) at which the coil's current can be followed from sample to sample; inf without resistance."""
    coil = sensor.coil
    if coil.resistance == 0:
        return inf
    return (LARGEST_DECAY * sensor.acquisition.rate * coil.constant / coil.resistance - coil.core_length) / 2


def samples_and_periods(sensor: SelfSensor) -> tuple[int, int]:
    """The smallest whole numbers of samples and PWM periods that last equally long.

    Raises:
        ValueError: More than 10,000 samples.
    """
    ratio = whole_ratio(sensor.acquisition.rate, sensor.supply.frequency)
    if ratio is None or ratio[0] > 10_000:
        raise ValueError(
            f"acquisition: rate = {sensor.acquisition.rate:g} Hz and the PWM frequency {sensor.supply.frequency:g} Hz "
            "are in no ratio of whole numbers below 1,000; choose, say, 250 kHz for 25 kHz"
        )
    return ratio


def whole_ratio(rate: float, other: float) -> tuple[int, int] | None:
    """rate / other as integers, the second at most 1,000, to within 1e-9; None where there are none."""
    ratio = Fraction(rate / other).limit_denominator(1000)
    return ratio.as_integer_ratio() if abs(float(ratio) * other / rate - 1) <= 1e-9 else None


def structure_of(sensor: SelfSensor, regulated: bool) -> SensorStructure:
    """The kernel that a sensor needs; regulated means that its supply follows a mean current and not a given drive."""
    return SensorStructure(
        rms=sensor.estimator.path.rms,
        emf=sensor.coil.back_emf,
        core=sensor.coil.has_core_losses,
        dead=sensor.supply.dead_time > 0,
        adc=sensor.acquisition.bits > 0,
        noise=sensor.acquisition.noise > 0,
        drifting=samples_and_periods(sensor)[1] > 1,
        regulated=regulated,
    )


def sensor_rows(sensors: Sequence[SelfSensor]) -> np.ndarray:
    """Rows (SENSOR_ROWS, n) of n sensors at rest, their coils without current."""
    return np.array([_rows(sensor) for sensor in sensors]).T


def _rows(s: SelfSensor) -> np.ndarray:
    rows = LaneRows(np.zeros((k.SENSOR_ROWS, 1)))
    coil, model, rate = s.coil, s.estimator.coil, s.acquisition.rate
    rows[k.GAP] = rows[k.ESTIMATE] = rows[k.INTEGRAL] = rows[k.REST_GAP] = s.gap
    rows[k.ALPHA], rows[k.ON], rows[k.OFF] = 0.5, 1.0, -1.0
    rows[k.INVERSE_0], rows[k.INVERSE_1] = _inverse(coil)
    rows[k.RESISTANCE], rows[k.VOLTAGE] = coil.resistance, s.supply.voltage
    rows[k.MAGNET_EMF], rows[k.EDDY_RATE] = coil.magnet_emf, 1.0
    per_length = coil.core_length / coil.constant
    if coil.lamination:
        rows[k.EDDY_RATE], rows[k.CORE_SHARE] = 1 / coil.diffusion_time, per_length
    if coil.saturation_field is not None:
        per_field = 1 / (coil.turns * coil.pole_area * coil.saturation_field)
        rows[k.SATURATED], rows[k.PER_FIELD] = per_length / per_field, per_field
        rows[k.BIAS_FIELD] = coil.bias_field / coil.saturation_field
    rows[k.PERIOD] = 1 / s.supply.frequency
    rows[k.DEAD], rows[k.STATES_3] = s.supply.dead_time * s.supply.frequency, s.supply.states == 3
    rows[k.NOISE] = s.acquisition.noise
    if s.acquisition.bits:
        rows[k.COUNTS], rows[k.PER_COUNT] = 1 / s.acquisition.resolution, s.acquisition.resolution
        rows[k.COUNT_MAX] = 2.0 ** (s.acquisition.bits - 1)
    rows[k.MODEL_INVERSE_0], rows[k.MODEL_INVERSE_1] = _inverse(model)
    rows[k.MODEL_RESISTANCE], rows[k.MODEL_VOLTAGE] = model.resistance, s.estimator.voltage
    rows[k.INTERVAL] = 1 / rate
    rows[k.KP], rows[k.KI_INTERVAL] = s.estimator.kp, s.estimator.ki / rate
    rows[k.LOWEST], rows[k.HIGHEST] = s.estimator.gap_range
    before, behind = s.estimator.path.sections(rate)
    rows[k.BEFORE], rows[k.BEHIND] = before.reshape(-1, 1), behind.reshape(-1, 1)
    rows[k.SCALE], rows[k.SHIFT] = s.scale, s.shift
    return rows.values[:, 0]


def _inverse(coil: Coil) -> tuple[float, float]:
    """1 / L = first + second * gap."""
    return coil.core_length / coil.constant, 2 / coil.constant
