"""Coil current in, air gap out. Knows no rig."""

from selfsense.bound import NoisePoint, cramer_rao_density, cramer_rao_rms, noise_sweep
from selfsense.calibration import StaticCalibration, static_calibration, static_sweep
from selfsense.coil import Coil, coil_inductance
from selfsense.demodulation import demodulated_gap, demodulation_error, duty_swing, ripple_amplitude
from selfsense.design import PIDesign, assess, design_pi, pi_gains, trade_off, with_gains
from selfsense.dynamic_calibration import DynamicCalibration, dynamic_calibration, simulated_dynamic
from selfsense.forward_path import AnalogPath, DigitalPath
from selfsense.linear import forward_response, stable, tracking
from selfsense.rate_limit import gains_with_limit, lowest_stable_rate
from selfsense.recorded import RecordedGap, estimate_recorded
from selfsense.robustness import MismatchErrors, mismatches, robustness
from selfsense.sensor import Estimator, SelfSensor
from selfsense.simulate import SensedGap, simulate
from selfsense.supply import Acquisition, Supply
from selfsense.validity import Stretch, sensed_validity

__all__ = [
    "Acquisition",
    "AnalogPath",
    "Coil",
    "DigitalPath",
    "DynamicCalibration",
    "Estimator",
    "MismatchErrors",
    "NoisePoint",
    "PIDesign",
    "RecordedGap",
    "SelfSensor",
    "SensedGap",
    "StaticCalibration",
    "Stretch",
    "Supply",
    "assess",
    "coil_inductance",
    "cramer_rao_density",
    "cramer_rao_rms",
    "demodulated_gap",
    "demodulation_error",
    "design_pi",
    "duty_swing",
    "dynamic_calibration",
    "estimate_recorded",
    "forward_response",
    "gains_with_limit",
    "lowest_stable_rate",
    "mismatches",
    "noise_sweep",
    "pi_gains",
    "ripple_amplitude",
    "robustness",
    "sensed_validity",
    "simulate",
    "simulated_dynamic",
    "stable",
    "static_calibration",
    "static_sweep",
    "tracking",
    "trade_off",
    "with_gains",
]
