"""Self-sensing: the table of a rig that describes the supply, acquisition and estimator that replace the probe."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from maglev_env.fields import is_number
from maglev_env.loop.system import System
from selfsense.baseband import STATES as BASEBAND
from selfsense.baseband import baseband
from selfsense.design import LAG, LAG_AT
from selfsense.forward_path import AnalogPath, DigitalPath
from selfsense.sensor import SelfSensor
from selfsense.supply import Acquisition, Supply, check_rates

PATHS = {"digital": DigitalPath, "analog": AnalogPath}


@dataclass(frozen=True)
class SelfSensing:
    """A rig's [self_sensing] table; supply voltage, coil and current noise are parameters of the rig itself.

    Args:
        pwm_frequency: Hz.
        sample_rate: of the current, Hz.
        dead_time: of the supply, s.
        core_length: length of the core divided by its relative permeability, m.
        adc_bits: of the current's converter; 0: ideal.
        current_range: the converter covers +-current_range, A.
        forward_path: "digital" or "analog".
        kp: gain of the estimator, m/A; None for kp and ki: those with the largest phase margin at the given lag.
        ki: gain of the estimator, m/(A s), above 0: without it no error would be removed.
        lag: of the estimated gap at lag_frequency, degrees.
        lag_frequency: Hz.

    Raises:
        ValueError: A value has the wrong type or is out of its range.
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
        for name, least in (("core_length", 0), ("kp", 0), ("ki", None), ("lag", None), ("lag_frequency", None)):
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


STATES = tuple(f"estimator{k}" for k in range(BASEBAND))


def reading(system: System, sensors: Sequence[SelfSensor], displacement: np.ndarray) -> np.ndarray:
    """Signal of the displacement (m) that each lane's self-sensor reads.

    Args:
        system: with all of STATES, whose equations are written.
        sensors: one of each lane.
        displacement: signal of the rotor's displacement, m.
    """
    own = system.signals(STATES)
    a, b, c = (np.array(part) for part in zip(*map(baseband, sensors), strict=True))
    rates = a @ own + b[:, :, None] * displacement[:, None]
    system.put_all(STATES, rates * system.step[:, None, None])
    return (c[:, None] @ own)[:, 0]
