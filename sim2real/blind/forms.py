"""Effects in the twin's own forms: from parameters and named effects to the constants of a `Machine`.

The sealed and the development generator realise the same effect differently, so that what is tuned on one is not fitted
to the other. Labels use the vocabulary of the diagnosis: a time constant is the sum of the lags that it stands for, and
an eddy corner is where the half-order asymptote reaches one.
"""

from collections.abc import Mapping
from math import log, pi, sqrt
from typing import Literal

import numpy as np

from sim2real.blind import machine as kinds
from sim2real.blind.machine import Machine

Forms = Literal["sealed", "development"]
Effects = Mapping[str, Mapping[str, float]]
MU_0 = 4e-7 * pi
LADDER = {"sealed": 10, "development": 7}
# Thresholds of the play operators relative to the width, and their shares.
PLAYS = {
    "sealed": (np.array([0.2, 0.6, 1.0, 1.4, 1.8]), np.full(5, 0.2)),
    "development": (np.array([0.4, 1.0, 1.6]), np.array([0.3, 0.4, 0.3])),
}
SQUARE_SHARE, SQUARE_SPEED = 0.1, 5e-3  # share of the damping that is quadratic, and the speed at which it is, m/s
BEND = 0.01  # current over which the halves of an asymmetric gain pass into each other, A
REACH = 2e-5  # distance over which a hardening spring grows faster than with the cube, m
HERTZ = 1.5  # exponent of a soft stop by Hertz
BURST = 0.3  # probability that a dropped sample is followed by another one, beyond chance
STATIC_OVER_COULOMB = {"sealed": 1.2, "development": 1.3}


def magnets(p: Mapping[str, float]) -> dict[str, float]:
    """Constants of the force law of a hybrid pair whose control flux crosses the gaps, calibrated to the rig."""
    coil_flux = 0.5 * MU_0 * p["turns"]
    mu_m = p["recoil_permeability"] * MU_0
    magnet_flux = 0.5 * MU_0 * p["remanence"] * p["magnet_length"] / mu_m
    magnet_gap = 0.5 * MU_0 * p["magnet_length"] * p["pole_area"] / (mu_m * p["magnet_area"])
    area, step = p["bearings"] * p["pole_area"] / (2 * MU_0), 1e-30

    def pull(y: complex, i: complex) -> complex:
        up, down = p["gap"] - y, p["gap"] + y
        upper = magnet_flux / (up + magnet_gap) + coil_flux * (p["bias_current"] + i) / up
        lower = magnet_flux / (down + magnet_gap) + coil_flux * (p["bias_current"] - i) / down
        return area * (upper**2 - lower**2)

    # Complex steps give derivatives without the difference of nearly equal numbers.
    gain, stiffness = pull(0, 1j * step).imag / step, -pull(1j * step, 0).imag / step
    return {
        "area": area,
        "magnet_flux": magnet_flux,
        "magnet_gap": magnet_gap,
        "coil_flux": coil_flux,
        "bias": p["bias_current"],
        "gain_scale": p["actuator_gain"] / gain,
        "stiffness_scale": p["negative_stiffness"] / stiffness,
    }


def ladder(corner_hz: float, diffusion: float, depth: int) -> tuple[np.ndarray, np.ndarray]:
    """Rates (1/s) and shares of 1 / (1 + r (z coth z - 1)), z^2 = s diffusion: a gap and a solid plate in series.

    The plate's reluctance is the Cauer ladder z coth z = 1 + z^2 / (3 + z^2 / (5 + ...)), truncated at `depth`; r
    places the asymptote 1 / (1 + sqrt(s / w)) at the corner. The rest of 1 beyond the shares passes without lag.
    """
    ratio = 1 / sqrt(2 * pi * corner_hz * diffusion)
    top, bottom = np.array([1.0]), np.array([2.0 * depth + 1.0])  # the last rung as a ratio of polynomials in z^2
    for odd in range(2 * depth - 1, 1, -2):
        top, bottom = bottom, np.polyadd(odd * bottom, np.polymul(top, [1.0, 0.0]))
    rung = np.polymul(top, [1.0, 0.0])  # z coth z - 1 = z^2 top / bottom
    denominator = np.polyadd(bottom, ratio * rung)
    poles = np.roots(denominator).real
    residues = np.polyval(bottom, poles) / np.polyval(np.polyder(denominator), poles)
    return -poles / diffusion, -residues / poles


def machine(p: Mapping[str, float], effects: Effects, forms: Forms) -> Machine:
    """The twin of a rig.

    Tones (runout, pickup, unbalance, vibration) and dropped samples are signals and not constants; see `twin.simulate`.

    Args:
        p: True parameters, SI.
        effects: {name: {parameter: value}}, SI.
        forms: Which forms realise the effects.
    """
    sealed = forms == "sealed"
    changed = dict(p)
    for name, key in PARAMETER_OF.items():
        if name in effects:
            changed[key] = p[key] * (1 + effects[name]["change"])
    m = Machine(
        mass=changed["mass"],
        spring=changed["support_stiffness"],
        damper=p["support_damping"],
        gap=p["gap"],
        **magnets(changed),
        amplifier=p["amplifier_time_constant"],
        inductance=p["coil_inductance"],
        resistance=p["coil_resistance"],
        sensor=p["sensor_time_constant"],
        probe=changed["probe_gain"],
        probe_nominal=p["probe_nominal"],
        adc_step=2 * p["voltage_range"] / 2 ** p["adc_bits"],
        dac_step=2 * p["voltage_range"] / 2 ** p["dac_bits"],
        volts=p["voltage_range"],
        rate=p["control_rate"],
    )
    for name, values in effects.items():
        if name in _FORMS:
            m = m._replace(**_FORMS[name](values, p, m, sealed))
    return m


PARAMETER_OF = {
    "mass": "mass",
    "actuator_gain": "actuator_gain",
    "negative_stiffness": "negative_stiffness",
    "support_stiffness": "support_stiffness",
    "sensor_gain": "probe_gain",
}


def _amplifier_lag(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    t = e["time_constant"]
    if sealed:
        return {"amplifier_extra": np.array([t / 2, t / 2])}
    return {"amplifier_extra": np.array([0.8 * t]), "delay": m.delay + 0.2 * t}


def _sensor_lag(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    t = e["time_constant"]
    return {"sensor_extra": np.array([t / 2, t / 2] if sealed else [0.8 * t, 0.2 * t])}


def _voltage(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    return {"voltage": e["voltage"], "voltage_kind": kinds.SOFT if sealed else kinds.HARD}


def _eddy(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    rates, shares = ladder(e["corner_hz"], e["diffusion"], LADDER["sealed" if sealed else "development"])
    return {"eddy_rates": rates, "eddy_shares": shares}


def _hysteresis(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    widths, shares = PLAYS["sealed" if sealed else "development"]
    return {"stops": widths * e["width"], "stop_shares": shares * e["strength"]}


def _saturation(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    return {"knee": e["field"], "knee_kind": kinds.ARCTAN if sealed else kinds.FROEHLICH}


def _force_law(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    return {"steepness": e["exponent"], "steepness_kind": kinds.DECAYING if sealed else kinds.FARTHER}


def _damping(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    c, share = e["coefficient"], SQUARE_SHARE if sealed else 0.0
    return {"damper": m.damper + (1 - share) * c, "drag_square": share * c / SQUARE_SPEED}


def _friction(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    static = STATIC_OVER_COULOMB["sealed" if sealed else "development"] * e["force"]
    kind = kinds.LUGRE if sealed else kinds.STRIBECK
    constants = {"coulomb": e["force"], "static": static, "stribeck": e["velocity"]}
    return {"friction_kind": kind, "bristle": e.get("bristle", 1.0), **constants}


def _sensor_resonance(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    return {
        "mount_kind": kinds.PLATE_ON_BASE if sealed else kinds.PLATE,
        "mount_rate": 2 * pi * e["frequency"],
        "mount_damping": e["damping_ratio"],
        "mount_coupling": e["coupling"],
    }


def _support_resonance(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    return {
        "body_mass": e["mass_ratio"] * p["mass"],
        "body_rate": 2 * pi * e["frequency"],
        "body_damping": e["damping_ratio"],
    }


def _asymmetric_gain(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    if not sealed:
        return {
            "curve_at": np.array([-1.0, 0.0, 1.0]),
            "curve_to": np.array([-1.0 + e["change"], 0.0, 1.0 + e["change"]]),
        }
    at = BEND * np.sinh(np.linspace(-6.0, 6.0, 25) * log(20.0) / 3.0)  # closer together about the bend
    return {"curve_at": at, "curve_to": at + e["change"] * (np.hypot(at, BEND) - BEND)}


def _deadband(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    return {"deadband": e["half_width"], "deadband_kind": kinds.ROUND if sealed else kinds.SHARP}


def _gain_drift(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    return {"drift": e["change"], "drift_kind": kinds.WARMING if sealed else kinds.STEADY}


def _cubic_spring(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    return {"spring_cubic": e["coefficient"], "spring_reach": REACH if sealed else np.inf}


def _soft_stop(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    power = HERTZ if sealed else 1.0
    return {"stop_at": e["distance"], "stop_stiffness": e["stiffness"], "stop_power": power}


def _probe_backlash(e: Mapping, p: Mapping, m: Machine, sealed: bool) -> dict:
    return {"plays": e["half_width"] * (np.array([0.6, 1.0, 1.4]) if sealed else np.ones(1))}


_FORMS = {
    "delay": lambda e, p, m, sealed: {"delay": m.delay + e["time"]},
    "amplifier_lag": _amplifier_lag,
    "amplifier_voltage_limit": _voltage,
    "force_law": _force_law,
    "eddy_current": _eddy,
    "hysteresis": _hysteresis,
    "saturation": _saturation,
    "eccentricity": lambda e, p, m, sealed: {"offset": e["offset"]},
    "sensor_lag": _sensor_lag,
    "sensor_resonance": _sensor_resonance,
    "damping": _damping,
    "friction": _friction,
    "support_resonance": _support_resonance,
    "deadband": _deadband,
    "gain_drift": _gain_drift,
    "actuator_offset": lambda e, p, m, sealed: {
        "curve_at": np.array([-1.0, 1.0]),
        "curve_to": e["current"] + np.array([-1.0, 1.0]),
    },
    "asymmetric_gain": _asymmetric_gain,
    "cubic_spring": _cubic_spring,
    "soft_stop": _soft_stop,
    "quadratic_probe": lambda e, p, m, sealed: {"probe_square": e["coefficient"]},
    "cubic_probe": lambda e, p, m, sealed: {"probe_cube": e["coefficient"]},
    "probe_backlash": _probe_backlash,
}
