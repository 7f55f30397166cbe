"""The dynamic calibration on the rig, Figures 6.30 to 6.32: 30 degrees at 150 Hz and a dip at 75 Hz."""

from dataclasses import replace

import numpy as np
import scipy

from estimation.stability_margins import margin_arrays
from maglev_env.design.defaults import with_defaults
from maglev_env.experiment import protocol_experiment
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.reproduce.chapters.self_sensed.self_sensing_sensor import (
    LAG_AT,
    LAG_IN_D,
    designed_for,
    dissertation_sensor,
    lines_figure,
)
from maglev_workbench.commands.reproduce.item import Outcome, Row
from maglev_workbench.commands.selfsense.calibrate.numbers import MEASURED_AT, MEASURED_LAG
from maglev_workbench.commands.selfsense.calibrate.sources import PEAK
from maglev_workbench.commands.selfsense.design.figures import MARGIN_IN_D
from selfsense.bound import noise_sweep
from selfsense.calibration.dynamic import DynamicCalibration, simulated_dynamic
from selfsense.design import assess, with_gains
from selfsense.linear import linearise, tracking
from selfsense.sensor import SelfSensor

DIP = 75.0  # Hz
NOISE = 15e-3  # A rms: the estimate's noise is then about a fifth of its signal, as the rig's
CREST = 1.68  # peak over rms of a flat Schroeder multisine
CORNERS = (2e3, 5e3, 20e3)  # Hz of the averaging behind the rms converter, which is not published
_PERIODS = 4


def dynamic_calibration(seed: int) -> Outcome:
    """Lag, delay and dip of the simulated estimator and the measured ones, and an estimator that would lag as much."""
    rig, sensor = dissertation_sensor()
    quiet = _calibrated(sensor, seed)
    noisy = replace(sensor, acquisition=replace(sensor.acquisition, noise=NOISE))
    loud, noise = _calibrated(noisy, seed), noise_sweep(noisy, [0], [NOISE])[0].rms
    close = tracking(designed_for(sensor, LAG_IN_D), np.array([MEASURED_AT]))[0]
    signal = PEAK * sensor.gap / CREST
    measured = MEASURED_LAG / 360 / MEASURED_AT
    slow = {corner: slow_estimator(corner) for corner in CORNERS}
    as_slow = assess(slow[5e3], MEASURED_AT)
    level = [_level(s) for s in slow.values()]
    spread = [float(assess(s, MEASURED_AT).phase_margin) for s in slow.values()]
    margins = {name: _delay_margin(name) for name in (rig.name, "eframe")}
    gap = "unexplained by the estimator as designed; candidates in docs/case-studies.md"
    rows = (
        Row("lag at 150 Hz", MEASURED_LAG, _lag(quiet, MEASURED_AT), "°", 0.1, gap, kind="prediction"),
        Row(
            "the same with gains for 18° at 4 kHz",
            MEASURED_LAG,
            -float(np.degrees(np.angle(close))),
            "°",
            0.1,
            gap,
            kind="prediction",
            again="dynamic-calibration",
        ),
        Row(
            "delay of that lag",
            1e6 * measured,
            1e6 * quiet.delay,
            "µs",
            0.1,
            gap,
            kind="prediction",
            again="dynamic-calibration",
        ),
        Row(
            "delay measured over that of the simulated 18° at 4 kHz",
            None,
            measured / (LAG_IN_D / 360 / LAG_AT),
            reason="556 µs over 12.5 µs, from the published degrees",
        ),
        Row(
            "dip of the phase at 75 Hz",
            "seen",
            _dip(quiet),
            "°",
            reason="the estimator makes none: docs/case-studies.md",
        ),
        Row("level at 150 Hz against 1 Hz", "constant", _decibels(quiet), "dB"),
        Row(
            "with noise: noise over signal",
            0.2,
            noise / signal,
            within=0.2,
            reason="'around 1 to 5', read as 1 : 5",
            kind="fit",
        ),
        Row(
            "with noise: delay",
            1e6 * measured,
            1e6 * loud.delay,
            "µs",
            0.1,
            "white noise of the current does not delay",
            kind="prediction",
            again="dynamic-calibration",
        ),
        Row("with noise: half the 95 % interval of it", None, 1e6 * (loud.delay_high - loud.delay_low) / 2, "µs"),
        Row(
            "analog path with 30° at 150 Hz: phase margin",
            MARGIN_IN_D,
            as_slow.phase_margin,
            "°",
            0.03,
            kind="fit",
            again="estimator-response",
        ),
        Row("its crossover", None, as_slow.crossover, "Hz", reason="integral gain alone, averaging at 5 kHz"),
        Row("its level at 150 Hz", "constant", level[1], "dB", reason="the scale of a figure may hide it"),
        Row(
            "its margin if averaged at 2 kHz",
            MARGIN_IN_D,
            spread[0],
            "°",
            0.03,
            f"level {level[0]:.2f} dB",
            kind="fit",
            again="estimator-response",
        ),
        Row(
            "its margin if averaged at 20 kHz",
            MARGIN_IN_D,
            spread[2],
            "°",
            0.03,
            f"level {level[2]:.2f} dB",
            kind="fit",
            again="estimator-response",
        ),
        Row(
            "1 to 150 Hz in time: rms difference over rms with the measured delay",
            "minimal time delay",
            _apart(measured),
            reason="flat lines; with 30° at 150 Hz the curves of Figure 6.30 agree only if the low lines dominate them",
            means=(0, 0.1),
            kind="consequence",
        ),
        Row(
            "the same with the simulated estimator's",
            "minimal time delay",
            _apart(quiet.delay),
            means=(0, 0.1),
            kind="prediction",
            again="dynamic-calibration",
        ),
        Row(f"delay margin of {rig.name} levitated with a probe", None, 1e6 * margins[rig.name], "µs"),
        Row("delay margin of eframe levitated with a probe", None, 1e6 * margins["eframe"], "µs"),
        Row(
            f"right-most pole of {rig.name} levitated by that slow estimator",
            None,
            right_most_pole(slow[5e3]),
            "1/s",
            reason=f"{right_most_pole(None):.0f} with the probe: at the limit, not useful",
        ),
    )
    f = np.linspace(1.0, 2 * MEASURED_AT, 150)
    traces = [("published: -30° at 150 Hz", [MEASURED_AT - 2, MEASURED_AT + 2], [-MEASURED_LAG] * 2)]
    named = {"estimator for 35° at 4 kHz": sensor, "analog path, integral gain": slow[5e3]}
    traces += [(name, f, np.degrees(np.unwrap(np.angle(tracking(s, f))))) for name, s in named.items()]
    traces.append(("pure delay of 556 µs", f, -360 * f * measured))
    figure = lines_figure("frequency in Hz", "phase in degrees", traces)
    notes = (
        "The measured delay is not the simulated estimator's, with its published 18 degrees at 4 kHz or with more, and "
        "white noise of the current does not make it. docs/case-studies.md weighs what else may, and the dip.",
        "One candidate is the estimator itself with slower gains: of the analog path with nothing but integral gain, "
        f"30 degrees at 150 Hz leave {as_slow.phase_margin:.0f} degrees of margin, the published 83 of the circuit. "
        f"It costs {-level[1]:.1f} dB at 150 Hz, against an amplitude published as constant, and the margin moves by "
        "10 degrees with the averaging's corner, so this is a hypothesis: calibrated up to 300 Hz it would lose 3 dB "
        "there, a pure delay nothing.",
        "That 83 degrees exceed the 30 says nothing of stability: they are the margin of the estimator's own loop. "
        f"What a delay of 556 µs uses up is the levitation loop's margin: {1e6 * margins[rig.name]:.0f} µs on "
        f"{rig.name} with the gains of Table 3.5, nearly all of it, but a small part of eframe's.",
    )
    return Outcome(rows, (("Phase of estimate over displacement", figure),), notes)


def slow_estimator(corner: float) -> SelfSensor:
    """The analog path, averaged at a corner (Hz), with the integral gain alone whose estimate lags as measured."""
    _, sensor = dissertation_sensor("analog")
    path = replace(sensor.estimator.path, low_pass=corner)
    sensor = replace(sensor, estimator=replace(sensor.estimator, path=path))
    at, unit = np.array([MEASURED_AT]), 2 * np.pi / float(np.abs(linearise(sensor).forward(0.0)))

    def excess(ki: float) -> float:
        return -float(np.degrees(np.angle(tracking(with_gains(sensor, 0.0, ki), at)[0]))) - MEASURED_LAG

    # An integrator that crosses 1 at 50 Hz lags by 70 degrees at 150 Hz, one at 2 kHz by less than 10.
    return with_gains(sensor, 0.0, scipy.optimize.brentq(excess, 50 * unit, 2000 * unit))


def right_most_pole(sensor: SelfSensor | None) -> float:
    """Real part (1/s) of the right-most pole of hmb_free with Table 3.5, read by its probe or by a sensor's gains."""
    rig = with_defaults(load_rig("hmb_free"))
    if sensor is not None:
        gains = {"kp": sensor.estimator.kp, "ki": sensor.estimator.ki}
        rig = replace(rig, self_sensing=replace(rig.self_sensing, forward_path="analog", **gains))
    experiment = protocol_experiment(rig, sensor="probe" if sensor is None else "self_sensing")
    return float(rig.control_rate * np.log(np.abs(closed_loop_poles(experiment)).max()))


def _delay_margin(name: str) -> float:
    """Additional delay (s) at which a preset's loop with its probe becomes unstable."""
    rig = with_defaults(load_rig(name))
    frequency = np.geomspace(1.0, 0.45 * rig.control_rate, 2000)
    s = loop_response(protocol_experiment(rig), frequency).sensitivity
    return float(margin_arrays(frequency, s)["delay_margin"])


def _calibrated(sensor: SelfSensor, seed: int) -> DynamicCalibration:
    return simulated_dynamic(sensor, 1.0, MEASURED_AT, PEAK * sensor.gap, _PERIODS, seed=seed)


def _apart(delay: float) -> float:
    """Root mean square of a flat multisine of 1 to 150 Hz less its copy after a delay (s), over its own."""
    return float(np.sqrt(np.mean(4 * np.sin(np.pi * np.arange(1, MEASURED_AT + 1) * delay) ** 2)))


def _lag(found: DynamicCalibration, frequency: float) -> float:
    return float(np.degrees(found.lag(frequency)[0]))


def _dip(found: DynamicCalibration) -> float:
    """Difference (degrees) between the phase at 75 Hz and the straight line from 50 to 100 Hz."""
    return _lag(found, DIP) - (_lag(found, DIP - 25) + _lag(found, DIP + 25)) / 2


def _decibels(found: DynamicCalibration) -> float:
    return float(20 * np.log10(np.abs(found.response[-1] / found.response[0])))


def _level(sensor: SelfSensor) -> float:
    low, high = np.abs(tracking(sensor, np.array([1.0, MEASURED_AT])))
    return float(20 * np.log10(high / low))
