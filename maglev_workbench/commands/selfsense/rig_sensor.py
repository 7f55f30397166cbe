"""The self-sensor of a command, and its description for the page."""

from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version

from maglev_env.design.defaults import with_defaults
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.self_sensor import rig_sensors
from maglev_workbench.page import rig_facts
from selfsense.sensor import SelfSensor

DEFAULT_RIG = "hmb_free"
OTHER_INDUCTANCE = 0.2  # share by which a stated inductance may differ from that of the geometry
DISSERTATION_RATE = 250e3  # Hz


def load_sensor(rig: str) -> tuple[Rig, SelfSensor]:
    """A rig (preset or TOML) and the self-sensor of its first axis.

    Raises:
        ValueError: The rig's coils cannot sense the gap.
    """
    loaded = with_defaults(load_rig(rig))
    return loaded, rig_sensors(loaded)[0]


def reading_text(sensor: SelfSensor) -> str:
    """Converter and noise of the coil current as text, such as: 12 bits over ±5 A, 2 mA rms noise."""
    a = sensor.acquisition
    converter = f"{a.bits} bits over ±{a.current_range:g} A" if a.bits else "ideal converter"
    return f"{converter}, {1e3 * a.noise:g} mA rms noise"


def sampling_note(sensor: SelfSensor) -> str:
    """Sentences on the sampling rate of the figures, and on how to change it."""
    rate, pwm = sensor.acquisition.rate, sensor.supply.frequency
    text = (
        f"The coil current is sampled at {rate / 1e3:g} kHz, {rate / pwm:.4g} times per PWM period of {pwm / 1e3:g} kHz"
    )
    if rate == DISSERTATION_RATE:
        return f"{text}, as in the dissertation. "
    return (
        f"{text}; the dissertation's rate is {DISSERTATION_RATE / 1e3:g} kHz. To change it, write sample_rate = "
        f"{DISSERTATION_RATE:g} under [self_sensing] in the rig TOML. "
    )


def other_inductance(rig: Rig, sensor: SelfSensor) -> str:
    """A sentence where the inductance that a rig states is not the one that self-sensing counts on; "" where it is."""
    counted = float(sensor.coil.inductance(sensor.gap))
    if rig.coil_inductance is None or abs(rig.coil_inductance / counted - 1) <= OTHER_INDUCTANCE:
        return ""
    return (
        f"the rig states a coil_inductance of {1e3 * rig.coil_inductance:.3g} mH; self-sensing counts on the "
        f"{1e3 * counted:.3g} mH of turns, pole_area and gap, by which the gap is wrong if the coil has the other"
    )


def made_by(rig: Rig, sensor: SelfSensor, **settings: object) -> Mapping[str, object]:
    """Names and values for a page's foot: rig, coil, supply, reading, estimator, the command's settings, version."""
    coil, e = sensor.coil, sensor.estimator
    other = other_inductance(rig, sensor)
    return {
        **{name: text for name, text in rig_facts(asdict(rig)).items() if name != "Excitation"},
        "Coil": f"{coil.turns:g} turns, {1e3 * float(coil.inductance(sensor.gap)):.3g} mH at {1e3 * sensor.gap:g} mm, "
        f"{coil.resistance:g} ohm" + (" (x axis)" if rig.axes == 2 else "") + (f"; {other}" if other else ""),
        "Supply": f"±{sensor.supply.voltage:g} V, {sensor.supply.frequency / 1e3:g} kHz",
        "Coil current": f"read at {sensor.acquisition.rate / 1e3:g} kHz, {reading_text(sensor)}",
        "Estimator": f"{type(e.path).__name__}, kp {e.kp:.4g} m/A, ki {e.ki:.4g} m/(A s), from "
        f"{1e6 * e.gap_range[0]:g} to {1e6 * e.gap_range[1]:g} µm",
        **settings,
        "Version": version("maglev-workbench"),
    }
