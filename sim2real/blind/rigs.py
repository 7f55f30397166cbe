"""The rigs of the twin: their nominal values, and the TOML of the one that is not a preset."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class PID:
    """Gains in A/m, A/m, A s/m, and time constants of the derivative and integral low-pass, s."""

    kp: float
    ki: float
    kd: float
    td: float
    ti: float


@dataclass(frozen=True)
class TwinRig:
    """Nominal parameters of a rig, SI, named as in a rig TOML.

    Attributes:
        source: What campaign.toml names as the rig.
        parameters: Nominal parameters.
        gains: PID gains.
        noise: Rms per sample of the readings.
        tolerance: Relative 1-sigma uncertainties.
        force_peak: Peak of the force excitation, N.
        injection_peak: Peak of the injection, A.
        toml: Text of the rig file; None for a preset.
    """

    source: str
    parameters: Mapping[str, float]
    gains: PID
    noise: Mapping[str, float]
    tolerance: Mapping[str, float]
    force_peak: float
    injection_peak: float
    toml: str | None = None


_HYBRID_PAIR = {
    "gap": 0.35e-3,
    "turns": 90,
    "pole_area": 39.27e-6,
    "magnet_area": 34.715e-6,
    "magnet_length": 5e-3,
    "remanence": 0.7,
    "recoil_permeability": 1.05,
    "bearings": 2,
    "bias_current": 0.20,
    "actuator_gain": 5.7,
    "negative_stiffness": -12.5e3,
    "coil_inductance": 0.57e-3,
    "coil_resistance": 2.0,
    "supply_voltage": 24.0,
    "amplifier_time_constant": 1e-4,
    "sensor_time_constant": 1.6e-5,
    "probe_gain": 8000.0,
}
_CONVERTERS = {"adc_bits": 16, "dac_bits": 14, "voltage_range": 10.0, "control_rate": 20000.0}  # defaults of a rig TOML
_GAINS = PID(8000.0, 2000.0, 5.2, 1e-4, 0.0318)
_NOISE = {"displacement": 0.5e-6, "force": 5e-3, "current": 2e-3}
_TOLERANCE = {
    "mass": 0.005,
    "actuator_gain": 0.05,
    "negative_stiffness": 0.10,
    "probe_gain": 0.02,
    "amplifier_time_constant": 0.10,
}
_FREE = {"mass": 0.08012, "support_stiffness": 0.0, "support_damping": 0.0}
_STAND = {"mass": 0.92, "support_stiffness": 134.5e3, "support_damping": 10.0}


def _table(name: str, values: Mapping[str, float]) -> str:
    return "\n".join(["", f"[{name}]", *(f"{key} = {value!r}" for key, value in values.items())]) + "\n"


def _stand_toml() -> str:
    head = 'schema = "maglev-rig/1"\nname = "stand"\nmagnet = "hybrid_pair"\naxes = 1\n'
    tables = [
        _table("parameters", _STAND | _HYBRID_PAIR),
        _table("gains", vars(_GAINS)),
        _table("noise", _NOISE),
        _table("tolerance", _TOLERANCE | {"support_stiffness": 0.02}),
        "\n[target]\nband = [60.0, 90.0]\npeak_sensitivity = 2.5\ncurrent_limit = 0.5\n",
        _table("protocol", {"periods": 5, "transient_periods": 1, "band_width": 15.0, "band_overlap": 12.0}),
    ]
    shaker = [line for line in range(1, 250) if line % 5]
    injected = sorted({*range(5, 251, 5), *(round(250 * 8 ** (n / 40)) for n in range(41))})
    for place, peak, lines in (("force", 1.5, shaker), ("current", 0.1, injected)):
        excitation = {"kind": "sphs", "at": place, "fundamental": 1.0, "amplitude": peak, "lines": lines}
        rows = [f"{key} = {value!r}".replace("'", '"') for key, value in excitation.items()]
        tables.append("\n".join(["", "[[protocol.excitation]]", *rows]) + "\n")
    return head + "".join(tables)


RIGS: Mapping[str, TwinRig] = {
    "hmb_free": TwinRig(
        "hmb_free", _FREE | _HYBRID_PAIR | _CONVERTERS, _GAINS, _NOISE, _TOLERANCE, force_peak=0.4, injection_peak=0.1
    ),
    "stand": TwinRig(
        "rig.toml",
        _STAND | _HYBRID_PAIR | _CONVERTERS,
        _GAINS,
        _NOISE,
        _TOLERANCE | {"support_stiffness": 0.02},
        force_peak=1.1,
        injection_peak=0.1,
        toml=_stand_toml(),
    ),
}
