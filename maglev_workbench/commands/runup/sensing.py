"""By how much a run-up on self-sensing errs, beside the same on the probes; and the bearings as identified."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from maglev_env.rotor.identification import MODES
from maglev_env.rotor.rotor import Rotor
from maglev_workbench.commands.runup.study import Report, slowest
from maglev_workbench.commands.selfsense.rig_sensor import reading_text
from maglev_workbench.page import number
from selfsense.linear import tracking

LAG_AT = 150.0  # Hz, where the dissertation measured 30 degrees (6.4)
ERRORS = ("rms", "mean", "largest")  # as `RunUp.gap_error`
SENSED = (
    "rpm", "error\nµm rms", "mean\nµm", "largest\nµm", "peak\nµm", "on probes\nµm", "coil\nA rms", "on probes\nA rms",
    "pole\n1/s", "on probes\n1/s",
)  # fmt: skip
SENSED_NOTE = (
    "Error of the self-sensed displacement, of the coil with the largest. Peak: of the probes, which only watch, from "
    "the centre. Pole: the slowest of the linear loop about the centre, which is not stable where it is positive."
)
IDENTIFIED = ("rpm", "mode", "controllers read", "stiffness\nN/m, N m/rad", "damping\nN s/m, N m s/rad", "peak |S|")
IDENTIFIED_NOTE = (
    "By SPHS injected at the controllers, with standard errors: of the rotor in its bearings under control, with the "
    "lag of the sensors taken off. Half the difference of the planes is larger for the same tilt where the planes lie "
    "further apart, as the coils do: probes in the coils' planes tell this from what self-sensing itself changes."
)


def sensed_rows(found: Report) -> list[Sequence[str]]:
    """Per speed, as SENSED."""
    beside = found.on_probes
    return [
        (
            f"{v:g}",
            *(number(error * 1e6) for error in found.result.gap_error[0, i]),
            *(number(float(one.result.peak[0, i].max()) * 1e6) for one in (found, beside)),
            *(number(float(one.result.coil_rms[0, i].max()), 2) for one in (found, beside)),
            *(number(slowest(one.rotor, v)) for one in (found, beside)),
        )
        for i, v in enumerate(found.speeds)
    ]


def identified_rows(found: Report) -> list[Sequence[str]]:
    """Per speed, mode and what was read, as IDENTIFIED; controllers of a and b have no mode whose |S| it were."""
    rows: list[Sequence[str]] = []
    for i, v in enumerate(found.id_speeds):
        for m, mode in enumerate(MODES):
            for name, one in found.identifications.items():
                values = (
                    f"{number(float(value[i, m]), 4)} ± {number(float(error[i, m]), 2)}"
                    for value, error in ((one.stiffness, one.stiffness_se), (one.damping, one.damping_se))
                )
                peak = number(float(one.peak_sensitivity[i, m])) if tuple(found.rotor.gains) == MODES else "–"
                rows.append((f"{v:g}", mode, name, *values, peak))
    return rows


def sensing_tables(found: Report) -> list[Table]:
    """Both tables for the terminal; none of a rotor on its probes."""
    if found.on_probes is None:
        return []
    tables = []
    for title, head, rows, caption in (
        ("On self-sensing, and on the probes", SENSED, sensed_rows(found), SENSED_NOTE),
        ("Bearings as identified", IDENTIFIED, identified_rows(found), IDENTIFIED_NOTE),
    ):
        one = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=0, caption=caption)
        for name in head:
            one.add_column(name, justify="right")
        for row in rows:
            one.add_row(*row)
        tables.append(one)
    return tables


def sensing_summary(found: Report) -> str:
    """A sentence, with a blank ahead, on self-sensing; "" on the probes."""
    if found.on_probes is None:
        return ""
    pole, error = max(slowest(found.rotor, v) for v in found.speeds), found.result.gap_error[0]
    if pole > 0:
        return (
            f" On self-sensing the linear loop is not stable: its slowest pole has {number(pole)} 1/s, on the probes "
            f"{number(max(slowest(found.on_probes.rotor, v) for v in found.speeds))} 1/s."
        )
    peak = found.on_probes.result.peak.max()
    return (
        f" On self-sensing: the displacement is off by up to {number(error[:, 0].max() * 1e6)} µm rms, "
        f"{number(error[:, 2].max() * 1e6)} µm at worst; on the probes the largest peak is {number(peak * 1e6)} µm."
    )


def sensor_text(rotor: Rotor) -> str:
    """What the controllers read, in words."""
    sensor = rotor.self_sensor
    if sensor is None:
        return "probes"
    lag = -np.degrees(np.angle(tracking(sensor, LAG_AT)))
    return (
        f"self-sensing by the coils, PWM {sensor.supply.frequency / 1e3:g} kHz, current at "
        f"{sensor.acquisition.rate / 1e3:g} kHz ({reading_text(sensor)}), estimator kp {sensor.estimator.kp:.4g} m/A, "
        f"ki {sensor.estimator.ki:.4g} m/(A s), which lags {lag:.3g}° at {LAG_AT:g} Hz"
    )


def sensing_json(found: Report) -> dict[str, Any]:
    """The sensor, and of each identification its coefficients, SI."""
    sensor = found.rotor.self_sensor
    estimator = None
    if sensor is not None:
        estimator = {
            "pwm_frequency": sensor.supply.frequency, "sample_rate": sensor.acquisition.rate,
            "kp": sensor.estimator.kp, "ki": sensor.estimator.ki,
        }  # fmt: skip
    names = "stiffness", "stiffness_se", "damping", "damping_se"
    return {
        "sensor": "probe" if sensor is None else "self_sensing",
        "estimator": estimator,
        "identified": [
            {"controllers_read": read, "speed_rpm": v, "mode": mode}
            | {name: getattr(one, name)[i, m] for name in names}
            for read, one in found.identifications.items()
            for i, v in enumerate(found.id_speeds)
            for m, mode in enumerate(MODES)
        ],
    }
