"""Self-sensing on a rig: which coil, supply and estimator take the probe's place."""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING

from maglev_env.loop.magnets.law import ForceLaw, force_law
from maglev_env.rig.excitation import is_number
from selfsense.coil import Coil
from selfsense.design import LAG, LAG_AT, design_pi
from selfsense.forward_path import AnalogPath, DigitalPath
from selfsense.sensor import Estimator, SelfSensor
from selfsense.supply import Acquisition, Supply, check_rates

if TYPE_CHECKING:
    from maglev_env.rig.rig import Rig

PATHS = {"digital": DigitalPath, "analog": AnalogPath}
LEAST_GAP, LARGEST_GAP = 0.02, 2.0  # of the rig's gap: where the estimator is held


@dataclass(frozen=True)
class SelfSensing:
    """A rig's [self_sensing] table; supply_voltage, coil and current noise are the rig's own.

    pwm_frequency and sample_rate in Hz, dead_time in s, core_length (m): of the core over its relative permeability;
    adc_bits (0: ideal) over +-current_range (A); forward_path digital or analog. kp (m/A) and ki (m/(A s)) of the
    estimator: where not given, those with the most phase margin at a lag of `lag` degrees at lag_frequency (Hz).
    ValueError when a value is not of its kind or out of its range.
    """

    pwm_frequency: float = 25e3
    sample_rate: float = 262.5e3
    dead_time: float = 0.0
    core_length: float = 0.0
    adc_bits: int = 12
    current_range: float = 5.0
    forward_path: str = "digital"
    kp: float | None = None
    ki: float | None = None
    lag: float = LAG
    lag_frequency: float = LAG_AT

    def __post_init__(self) -> None:
        if self.forward_path not in PATHS:
            raise ValueError(f"[self_sensing]: forward_path = {self.forward_path!r}; use {' or '.join(PATHS)}")
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name != "forward_path" and value is not None and not is_number(value):
                raise ValueError(f"[self_sensing]: {f.name} = {value!r} is not a finite number")
        if (self.kp is None) != (self.ki is None):
            raise ValueError("[self_sensing]: give both kp and ki, or neither")
        for name, least in (("core_length", 0), ("kp", 0), ("ki", 0), ("lag", None), ("lag_frequency", None)):
            value = getattr(self, name)
            if value is not None and (value < 0 or (least is None and value == 0)):
                raise ValueError(
                    f"[self_sensing]: {name} = {value:g} must be {'positive' if least is None else 'at least 0'}"
                )
        try:
            supply = Supply(frequency=self.pwm_frequency, dead_time=self.dead_time)
            check_rates(supply, Acquisition(self.sample_rate, self.adc_bits, self.current_range))
        except ValueError as error:
            raise ValueError(f"[self_sensing]: {error}") from None


def coil_of(rig: "Rig") -> Coil:
    """The upper coil of a one-axis rig. ValueError for a rig whose coil's inductance does not follow the gap."""
    if rig.magnet not in ("hybrid_pair", "electromagnet_pair", "electromagnet"):
        raise ValueError(
            f"rig {rig.name}: magnet = {rig.magnet!r} has no coil whose inductance follows the gap: "
            "self-sensing needs a hybrid_pair, an electromagnet_pair or an electromagnet; use the probe"
        )
    law = force_law(rig)
    coil_gap = law.coil_gap if isinstance(law, ForceLaw) else 0.0
    reach = rig.gap + law.magnet_gap
    return Coil(
        turns=rig.turns,
        pole_area=rig.pole_area,
        resistance=rig.coil_resistance,
        core_length=rig.self_sensing.core_length + 2 * coil_gap,
        magnet_emf=rig.turns * rig.pole_area * law.magnet_flux / reach**2,
        bias_field=law.magnet_flux / reach,
    )


def self_sensor(rig: "Rig", nominal: "Rig | None" = None) -> SelfSensor:
    """The self-sensor of a one-axis rig, its estimator made for the nominal rig (default: the rig itself).

    ValueError as `coil_of`, or when no estimator gains reach the lag that is asked for.
    """
    s, believed = rig.self_sensing, nominal or rig
    supply = Supply(rig.supply_voltage, s.pwm_frequency, 2, s.dead_time)
    acquisition = Acquisition(s.sample_rate, s.adc_bits, s.current_range, rig.noise.current)
    estimator = _estimator(replace(coil_of(believed), magnet_emf=0.0, bias_field=0.0), believed)
    return SelfSensor(coil_of(rig), supply, acquisition, estimator, believed.gap)


def _estimator(coil: Coil, rig: "Rig") -> Estimator:
    s = rig.self_sensing
    span = (LEAST_GAP * rig.gap, LARGEST_GAP * rig.gap)
    plain = Estimator(coil, rig.supply_voltage, s.kp or 0.0, s.ki or 0.0, span, PATHS[s.forward_path]())
    if s.kp is not None:
        return plain
    sensor = SelfSensor(coil, Supply(rig.supply_voltage, s.pwm_frequency), Acquisition(s.sample_rate), plain, rig.gap)
    kp, ki = _designed(sensor, s.lag, s.lag_frequency)
    return replace(plain, kp=kp, ki=ki)


@lru_cache(maxsize=256)
def _designed(sensor: SelfSensor, lag: float, frequency: float) -> tuple[float, float]:
    design = design_pi(sensor, lag, frequency)
    return design.kp, design.ki
