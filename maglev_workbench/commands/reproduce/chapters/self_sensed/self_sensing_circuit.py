"""The analog circuit: its band-pass and rms stage (6.4.1.2) and its static calibration (Table 6.1, Figure 6.28)."""

from dataclasses import replace
from math import inf, sqrt

import numpy as np
import scipy

from maglev_workbench.commands.reproduce.chapters.self_sensed.self_sensing_sensor import (
    dissertation_sensor,
    lines_figure,
)
from maglev_workbench.commands.reproduce.item import Outcome, Row
from maglev_workbench.commands.selfsense.calibrate.figures import line
from maglev_workbench.commands.selfsense.calibrate.numbers import gain_interval
from maglev_workbench.commands.selfsense.calibrate.sources import Axis, Static, simulated
from maglev_workbench.commands.selfsense.rig_sensor import DEFAULT_RIG, load_sensor
from selfsense.calibration.static import static_calibration
from selfsense.forward_path import response
from selfsense.sensor import samples_and_periods
from selfsense.simulate import simulate
from selfsense.validity import SETTLING

# Table 6.1: mm, mV.
DISPLACEMENT = np.array([0, 0.05, 0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40, 0.45, 0.49, 0.55, 0.60])
OUTPUT = np.array([0, 22, 46, 68, 90, 113, 136, 158, 180, 202, 220, 222, 223], dtype=float)
FINE = 2.5e6  # Hz: Tustin's rule bends the filter's upper edge at 250 kHz


def band_pass(seed: int) -> Outcome:
    """Gain and edges of the band-pass stages, and the rms converter's output for the ripple, Figures 6.18 to 6.20."""
    _, sensor = dissertation_sensor("analog", FINE)
    coil = replace(sensor.coil, resistance=0.0)
    sensor = replace(sensor, coil=coil, estimator=replace(sensor.estimator, coil=coil))
    path, supply = sensor.estimator.path, sensor.supply
    stages, _ = path.sections(FINE)

    def gain(frequency: float, count: int = 1) -> float:
        return float(np.abs(response(stages[:count], np.exp(2j * np.pi * np.array(frequency) / FINE))))

    def edges(count: int) -> tuple[float, float]:
        level = gain(path.centre, count) / sqrt(2)
        ends = ((1e3, path.centre), (path.centre, 200e3))
        low, high = (scipy.optimize.brentq(lambda f: gain(f, count) - level, *pair) for pair in ends)
        return low / 1e3, high / 1e3

    (low, high), both = edges(1), edges(2)
    cycle, _ = samples_and_periods(sensor)
    samples = round(SETTLING * FINE / cycle) * cycle
    settled = simulate([sensor], np.full(samples, sensor.gap)).amplitude[0, -cycle:]
    # A triangle of height h at half duty has the rms value h / (2 sqrt 3).
    rms = supply.voltage / supply.frequency / 2 / float(coil.inductance(sensor.gap)) / (2 * sqrt(3))
    why = (
        "a band-pass is symmetric in the logarithm: 10 to 40 kHz is centred on 20 kHz, and 25 kHz with a quality of "
        "0.83 passes 14 to 44"
    )
    rows = (
        Row("gain of a stage at 25 kHz", 1.15, gain(25e3), within=0.01, reason="as set", kind="consequence"),
        Row("width of a stage, -3 dB", 30.0, high - low, "kHz", 0.02, kind="consequence"),
        Row("lower edge of a stage", 10.0, low, "kHz", 0.05, why, kind="consequence"),
        Row("upper edge of a stage", 40.0, high, "kHz", 0.05, why, kind="consequence"),
        Row(
            "lower edge of both stages",
            10.0,
            both[0],
            "kHz",
            0.05,
            "two in a row are narrower still",
            kind="consequence",
            again="band-pass",
        ),
        Row(
            "upper edge of both stages",
            40.0,
            both[1],
            "kHz",
            0.05,
            "two in a row are narrower still",
            kind="consequence",
            again="band-pass",
        ),
        Row(
            "both stages at 150 Hz",
            "removed",
            20 * np.log10(gain(150.0, 2)),
            "dB",
            means=(-inf, -40),
            kind="consequence",
        ),
        Row("rms output over the ripple's rms", None, float(settled.mean()) / rms, reason="1.15² less harmonics"),
        Row(
            "ripple left on the output, peak to peak",
            None,
            100 * float(np.ptp(settled)) / float(settled.mean()),
            "%",
            reason="averaging behind the AD637 at 5 kHz, assumed: part values are in a figure only",
        ),
    )
    frequency = np.geomspace(1e3, 200e3, 200)
    decibels = [[20 * np.log10(gain(f, n)) for f in frequency] for n in (1, 2)]
    figure = lines_figure(
        "frequency in kHz",
        "gain in dB",
        [
            ("one stage", frequency / 1e3, decibels[0]),
            ("both stages", frequency / 1e3, decibels[1]),
            ("published edges", [10.0, 40.0], [20 * np.log10(1.15 / sqrt(2))] * 2),
        ],
        log=True,
    )
    notes = ("Centre, width and gain fit together; the published edges do not belong to them.",)
    return Outcome(rows, (("Band-pass of the analog forward path", figure),), notes)


def static_table(seed: int) -> Outcome:
    """Gain, linearity and range of Table 6.1, and of the simulated estimator over the same kind of steps."""
    found = static_calibration(DISPLACEMENT, OUTPUT)
    kept = DISPLACEMENT <= 0.55
    x, y = DISPLACEMENT[kept], OUTPUT[kept]
    # All of the points as one line: the tolerance lets the range take the saturated one in.
    saturated = static_calibration(x, y, tolerance=0.5)
    inside = x <= found.linear_range[1]
    off = np.abs(y - saturated.gain * x - saturated.offset)[inside].max() / y[inside].max()
    own = simulated(*load_sensor(DEFAULT_RIG), lambda: None).static[0].found
    table = Static("Table 6.1", DISPLACEMENT, OUTPUT, (Axis("displacement", "mm"), Axis("output", "mV")), found)
    low, high = gain_interval(table)
    counted = "the published line counts the first saturated point, 222 mV at 0.55 mm"
    rows = (
        Row("gain up to saturation", 430.0, found.gain, "mV/mm", 0.02, counted, kind="consequence"),
        Row(
            "gain with the point at 0.55 mm",
            430.0,
            saturated.gain,
            "mV/mm",
            0.02,
            counted,
            kind="consequence",
            again="static-calibration",
        ),
        Row(
            "linearity error up to saturation",
            2.4,
            100 * found.linearity_error,
            "% of full scale",
            0.1,
            counted,
            kind="consequence",
        ),
        Row(
            "with the point at 0.55 mm: largest deviation up to 0.49 mm",
            2.4,
            100 * float(off),
            "% of full scale",
            0.1,
            "the saturated point draws the line away from the others",
            kind="consequence",
            again="static-calibration",
        ),
        Row(
            "with the point at 0.55 mm: that point's deviation",
            None,
            100 * saturated.linearity_error,
            "% of full scale",
        ),
        Row("linear up to", 0.5, found.linear_range[1], "mm", 0.05, kind="consequence"),
        Row("simulated estimator: gain", None, own.gain, reason="estimated over true gap"),
        Row("simulated estimator: linearity error", None, 100 * own.linearity_error, "% of full scale"),
        Row("simulated estimator: linear from", None, 1e3 * own.linear_range[0], "mm", reason="of a gap of 0.35 mm"),
        Row("simulated estimator: linear up to", None, 1e3 * own.linear_range[1], "mm", reason="end of its search"),
    )
    notes = (
        f"The published table is better than its text: {found.gain:.1f} mV/mm (95 %: {low:.1f} to {high:.1f}) within "
        f"{100 * found.linearity_error:.2f} % of full scale, to the millivolt that it was read to. 0.43 V/mm lies "
        "outside the interval.",
        "The simulation knows no volts and no saturated op-amp: its range ends where the search does. Where the rig's "
        "output saturates says nothing of the coil.",
    )
    return Outcome(rows, (("Table 6.1 and its line", line(table)),), notes)
