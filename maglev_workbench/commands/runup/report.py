"""Results of `maglev runup` as a table for the terminal, as JSON and as an HTML page."""

from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from estimation.iso_14839 import iso_14839_3_zone
from maglev_env.loop.gains import Gains
from maglev_env.recordings.formats.json_data import plain
from maglev_env.rotor.operating_point import sag
from maglev_env.rotor.rotor import Rotor
from maglev_workbench.commands.runup.sensing import (
    ERRORS,
    IDENTIFIED,
    IDENTIFIED_NOTE,
    SENSED,
    SENSED_NOTE,
    identified_rows,
    sensed_rows,
    sensing_json,
    sensing_summary,
    sensor_text,
)  # fmt: skip
from maglev_workbench.commands.runup.study import Report, slowest, whirl
from maglev_workbench.page import facts, note, number, page, table

HEAD = (
    "rpm",
    "peak a\nµm",
    "peak b\nµm",
    "1x a\nµm",
    "linear\nµm",
    "axial\nµm",
    "coil\nA rms",
    "coil 1x\nA",
    "copper\nW",
)
HEAD += ("zone", "touchdown")
TWO_HOURS = 7200.0  # s, as the dissertation let it run (3.5)
NO_CONTACT = "No touchdown."
COLUMNS = (
    "Peak: of the probes, from the centre; 1x: amplitude once per turn, of the coils the largest; linear: as its model "
    "has it, – at rest and where its loop is not stable."
)


def summary(found: Report) -> str:
    """One or two sentences."""
    peak, clearance = found.result.peak[0].max(axis=-1), found.rotor.axis.clearance
    worst = int(peak.argmax())
    text = (
        f"{found.rotor.name}, {len(peak)} speeds from {found.speeds.min():g} to {found.speeds.max():g} rpm: largest "
        f"radial peak {number(peak[worst] * 1e6)} µm at {found.speeds[worst]:g} rpm, "
        f"{number(100 * peak[worst] / clearance, 2)} % of the clearance (zone {found.zones[worst]}). "
    )
    touched = [(v, t) for v, t in zip(found.speeds, found.touchdowns, strict=True) if t]
    if not touched:
        return text + NO_CONTACT + sensing_summary(found)
    speed, first = touched[0]
    contact = f"TOUCHDOWN at {len(touched)} speeds, first at {speed:g} rpm: {_contact(first)}."
    return text + contact + sensing_summary(found)


def run_up_table(found: Report) -> Table:
    """Per speed, for the terminal."""
    result = Table(title=f"Run-up of {found.rotor.name}", title_justify="left", box=SIMPLE_HEAD, padding=0)
    for name in HEAD:
        result.add_column(name, justify="right")
    for row, touched in zip(_rows(found), found.touchdowns, strict=True):
        result.add_row(*row, style="red" if touched else None)
    result.caption = f"{COLUMNS} Zone: ISO 14839-2, by the larger peak. Gains: {_all_gains(found.rotor)}."
    return result


def run_up_json(found: Report) -> dict[str, Any]:
    """JSON data, schema maglev-runup/1, SI units except for speeds in rpm."""
    up, motor = found.result, found.motor
    named = {
        "peak": up.peak[0], "once_per_turn": up.once[0, :, :2], "linear_model": found.expected,
        "axial_reading": up.once[0, :, 2], "coil_rms": up.coil_rms[0], "copper_loss": up.copper_loss[0],
        "coil_once": up.coil_once[0],
        "zone": found.zones, "touchdown": found.touchdowns, "heat": found.heat,
        "whirl_frequencies": whirl(found.rotor, found.speeds),
    }  # fmt: skip
    named |= {f"motor_{name}": values for name, values in (motor or {}).items()}
    if found.on_probes is not None:
        named |= {f"gap_error_{name}": up.gap_error[0, :, i] for i, name in enumerate(ERRORS)}
        named["slowest_pole"] = [slowest(found.rotor, v) for v in found.speeds]
    rows = [
        {"speed_rpm": float(v), **{name: values[i] for name, values in named.items()}}
        for i, v in enumerate(found.speeds)
    ]
    thermal = found.rotor.thermal
    return plain(
        {
            "schema": "maglev-runup/1",
            "version": version("maglev-workbench"),
            "rotor": found.rotor.name,
            "gains": {name: asdict(gains) for name, gains in found.rotor.gains.items()},
            "rejection": found.rotor.rejection and asdict(found.rotor.rejection),
            "seed": found.seed,
            **sensing_json(found),
            "clearance": found.rotor.axis.clearance,
            "speeds": rows,
            "sensitivity": [
                {
                    "speed_rpm": v,
                    "controller": name,
                    "peak_sensitivity": found.identified.peak_sensitivity[i, c],
                    "peak_frequency": found.identified.peak_frequency[i, c],
                    "zone": _sensitivity_zone(found.identified.peak_sensitivity[i, c]) or None,
                }
                for i, v in enumerate(found.id_speeds)
                for c, name in enumerate(found.rotor.gains)
            ],
            "spin_up_time": found.spin_up_time,
            "final_temperature_rise": None if thermal is None else thermal.resistance * found.heat,
            "on_probes": None if found.on_probes is None else run_up_json(found.on_probes),
        }
    )


def run_up_page(found: Report) -> str:
    """The HTML page with its figures."""
    from maglev_workbench.commands.runup import figures

    rotor = found.rotor
    held = sag(rotor)[[0, 2]] * 1e6
    sections = [
        ("Run-up", figures.run_up(found)),
        ("", note(
            "Points: measured, peaks from the centre; lines: the linear model, unbalance and runout as the probes "
            "read them. Dashed: where the zones of ISO 14839-2 meet. The weight holds the rotor "
            f"{number(float(np.hypot(*held)))} µm off the centre, which every peak includes.")),
        ("Per speed", table(HEAD, _rows(found))),
        ("", note(COLUMNS)),
        ("Whirl modes", figures.campbell(found)),
        ("", note(
            "Undamped: on the spring of the proportional gain and the magnets alone. Closed loop: frequency of its "
            "poles, more damped the paler. Where a line meets the speed of rotation, unbalance drives that mode.")),
        ("Peak sensitivity", figures.sensitivity(found)),
        ("", _sensitivity_table(found)),
        ("Bearings as identified", table(IDENTIFIED, identified_rows(found))),
        ("", note(IDENTIFIED_NOTE)),
    ]  # fmt: skip
    if found.on_probes is not None:
        sections += [("On self-sensing, and on the probes", table(SENSED, sensed_rows(found))), ("", note(SENSED_NOTE))]
    if rotor.motor is not None:
        sections += [("Motor", figures.motor(found)), ("", facts(_motor_facts(found)))]
    if rotor.thermal is not None:
        sections += [("Housing temperature", figures.temperature(found)), ("", facts(_thermal_facts(found)))]
    made = {"Sensor": sensor_text(rotor)}
    made |= {"Rotor": f"{rotor.name}, {rotor.body.mass:g} kg, axis {rotor.axis.name}", "Gains": _all_gains(rotor)}
    if rotor.rejection is not None:
        made["Force rejection"] = f"{rotor.rejection.rate:g} 1/s from {rotor.rejection.from_speed:g} rpm"
    return page(f"Run-up of {rotor.name}", summary(found), sections, made | {"Seed": found.seed})


def _rows(found: Report) -> list[Sequence[str]]:
    up = found.result
    return [
        (
            f"{v:g}",
            *(number(m * 1e6) for m in (*up.peak[0, i], up.once[0, i, 0], found.expected[i, 0], up.once[0, i, 2])),
            number(float(up.coil_rms[0, i].max()), 2),
            number(float(up.coil_once[0, i].max()), 2),
            number(float(up.copper_loss[0, i])),
            found.zones[i],
            "–" if touched is None else _contact(touched),
        )
        for i, (v, touched) in enumerate(zip(found.speeds, found.touchdowns, strict=True))
    ]


def _contact(touched: dict[str, Any]) -> str:
    return f"{touched['place']}, {number(touched['time'])} s, {number(touched['force'])} N"


def _all_gains(rotor: Rotor) -> str:
    """All that --gains may change, of every controller."""
    return "; ".join(f"{name} {_gains(one)}" for name, one in rotor.gains.items())


def _gains(gains: Gains) -> str:
    return f"kp {gains.kp:g} A/m, ki {gains.ki:g} A/m, kd {gains.kd:g} A s/m, td {gains.td:g} s, ti {gains.ti:g} s"


def _sensitivity_zone(peak: float) -> str:
    return "" if np.isnan(peak) else iso_14839_3_zone(float(peak))


def _sensitivity_table(found: Report) -> str:
    one = found.identified
    rows = [
        (f"{v:g}", name, number(one.peak_sensitivity[i, c]), number(one.peak_frequency[i, c]),
         _sensitivity_zone(one.peak_sensitivity[i, c]) or "touched down")
        for i, v in enumerate(found.id_speeds) for c, name in enumerate(found.rotor.gains)
    ]  # fmt: skip
    return table(("rpm", "controller", "peak |S|", "at Hz", "zone\n14839-3"), rows)


def _motor_facts(found: Report) -> list[tuple[str, str]]:
    motor, at = found.rotor.motor, int(abs(found.speeds).argmax())
    v, of = abs(found.speeds[at]), {name: values[at] for name, values in found.motor.items()}
    rows = [
        (f"At {v:g} rpm", f"{number(1e3 * of['torque'])} mN m, {number(of['current'])} A peak, copper "
         f"{number(of['copper_loss'])} W, {number(of['power'])} W in all without its driver"),
        ("Top speed", f"{number(motor.top_speed() * 30 / np.pi, 5)} rpm"),
    ]  # fmt: skip
    if found.spin_up_time is not None:
        rows.append((f"From rest to {v:g} rpm", f"{number(found.spin_up_time)} s at the greatest torque"))
    return rows


def _thermal_facts(found: Report) -> list[tuple[str, str]]:
    mass, at = found.rotor.thermal, int(abs(found.speeds).argmax())
    heat = float(found.heat[at])
    after = float(mass.temperature(TWO_HOURS, heat, 0.0))
    return [
        ("Heat", f"{number(heat)} W at {found.speeds[at]:g} rpm: coils, windings and all that drag takes"),
        ("Rise", f"{number(after)} K after two hours, {number(heat * mass.resistance)} K in the end"),
        ("Time constant", f"{number(mass.time_constant)} s"),
    ]
