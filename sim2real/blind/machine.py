"""The constants of one twin, in the form that the compiled stepping reads."""

from typing import NamedTuple

import numpy as np

NONE = np.zeros(0)
# Kinds of forms, for `Machine`'s switches.
ARCTAN, FROEHLICH = 1, 2
SOFT, HARD = 1, 2
LUGRE, STRIBECK = 1, 2
PLATE, PLATE_ON_BASE = 1, 2
DECAYING, FARTHER = 1, 2
ROUND, SHARP = 1, 2
WARMING, STEADY = 1, 2


class Machine(NamedTuple):
    """A rig with its effects, in SI units; with the defaults an effect is absent.

    Magnets: magnet_flux (T m) / (x + magnet_gap) and coil_flux (T m/A) I / x are the fields of a gap x; area is in
    N/T^2. amplifier and sensor are the time constants of the nominal poles (s), amplifier_extra and sensor_extra those
    of further poles. eddy_rates (1/s) belong to eddy_shares of the current; the rest passes without lag. stops (A) with
    stop_shares describe hysteresis.
    """

    mass: float
    spring: float
    damper: float
    gap: float
    area: float
    magnet_flux: float
    magnet_gap: float
    coil_flux: float
    bias: float
    gain_scale: float
    stiffness_scale: float
    amplifier: float
    inductance: float
    resistance: float
    sensor: float
    probe: float  # true gain, V/m
    probe_nominal: float
    adc_step: float
    dac_step: float
    volts: float
    rate: float
    delay: float = 0.0
    amplifier_extra: np.ndarray = NONE
    sensor_extra: np.ndarray = NONE
    voltage: float = np.inf
    voltage_kind: int = SOFT
    eddy_rates: np.ndarray = NONE
    eddy_shares: np.ndarray = NONE
    stops: np.ndarray = NONE
    stop_shares: np.ndarray = NONE
    knee: float = np.inf
    knee_kind: int = ARCTAN
    steepness: float = 0.0  # additional relative slope of each magnet's pull over the gap, at the gap
    steepness_kind: int = DECAYING
    offset: float = 0.0
    drag_square: float = 0.0
    spring_cubic: float = 0.0
    spring_reach: float = np.inf  # distance over which the cubic spring grows faster than with the cube, m
    friction_kind: int = 0
    coulomb: float = 0.0
    static: float = 0.0
    stribeck: float = 1.0
    bristle: float = 1.0
    mount_kind: int = 0
    mount_rate: float = 0.0
    mount_damping: float = 0.0
    mount_coupling: float = 0.0
    body_mass: float = 0.0
    body_rate: float = 0.0
    body_damping: float = 0.0
    deadband: float = 0.0
    deadband_kind: int = ROUND
    curve_at: np.ndarray = NONE  # currents (A) at which a static curve of the current that pulls is known
    curve_to: np.ndarray = NONE  # the current (A) that pulls there; linear between and beyond
    drift: float = 0.0  # of the actuator gain, over the whole recording
    drift_kind: int = STEADY
    probe_square: float = 0.0
    probe_cube: float = 0.0
    plays: np.ndarray = NONE  # half widths of play operators in the probe, m, which share its reading equally
    stop_at: float = np.inf  # distance of a soft stop, m; stop_stiffness: N/m, stop_power: exponent of the indentation
    stop_stiffness: float = 0.0
    stop_power: float = 1.0
