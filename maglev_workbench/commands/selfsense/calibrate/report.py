"""Calibrations: console tables, page and JSON."""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.selfsense.calibrate.figures import bode, line
from maglev_workbench.commands.selfsense.calibrate.numbers import (
    MEASURED_AT,
    MEASURED_LAG,
    TOP_LAG,
    deviation,
    dynamic_json,
    gain_interval,
    lag_at,
    lags,
    static_json,
    surely_within,
)
from maglev_workbench.commands.selfsense.calibrate.sources import (
    FUNDAMENTAL,
    PEAK,
    PERIODS,
    TOP,
    Axis,
    Calibration,
    Dynamic,
    Static,
)
from maglev_workbench.commands.selfsense.rig_sensor import made_by, reading_text
from maglev_workbench.page import facts, note, number, page, table, with_interval

if TYPE_CHECKING:
    import rich.table


def calibrate_tables(c: Calibration) -> "list[rich.table.Table]":
    """One table of names and values per calibration."""
    from rich import box
    from rich.table import Table

    found = []
    rows = [(f"static: {s.name}", _static_facts(s)) for s in c.static]
    for title, pairs in [*rows, *((f"dynamic: {d.name}", _dynamic_facts(d)) for d in c.dynamic)]:
        result = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=title, show_header=False)
        result.add_column()
        result.add_column()
        for name, text in pairs.items():
            result.add_row(name, text)
        found.append(result)
    return found


def calibrate_summary(c: Calibration) -> str:
    """Sentences on the first static and the first dynamic calibration, and the number of others."""
    parts = []
    if c.static:
        s = c.static[0]
        low, high = (_with_unit(v, s.axes[0]) for v in s.found.linear_range)
        saturated = [v for v in (s.found.saturated_below, s.found.saturated_above) if v is not None]
        beyond = f"; it saturates at {' and '.join(_with_unit(v, s.axes[0]) for v in saturated)}" if saturated else ""
        parts.append(
            f"The output follows the {s.axes[0].name} with a gain of {_gain(s)} from {low} to {high}, within "
            f"{number(100 * s.found.linearity_error, 2)} % of full scale{beyond}."
        )
    if c.dynamic:
        d = c.dynamic[0]
        at = " and ".join(f"{with_interval(lag, lag - h, lag + h)}° at {f:g} Hz" for f, (lag, h) in lags(d).items())
        text = f"It answers motion with a delay of {_delay(d)} µs and a bandwidth of {_bandwidth(d)}"
        parts.append(f"{text}; it lags {at}." if at else f"{text}.")
    more = len(c.static) + len(c.dynamic) - len(parts)
    return " ".join(parts) + (f" {more} more calibration{'s' if more > 1 else ''} below." if more else "")


def calibrate_json(c: Calibration) -> dict[str, Any]:
    """All calibrations as JSON data, schema maglev-selfsense-calibrate/1."""
    return plain(
        {
            "schema": "maglev-selfsense-calibrate/1",
            "version": version("maglev-workbench"),
            "source": c.source,
            "rig": c.rig and c.rig.name,
            "sensor": c.sensor,
            "static": [static_json(s) for s in c.static],
            "dynamic": [dynamic_json(d) for d in c.dynamic],
            "notes": c.notes,
        }
    )


def calibrate_page(c: Calibration) -> str:
    """The HTML of all calibrations."""
    sections: list = [("", note(". ".join(c.notes) + "."))] if c.notes else []
    for s in c.static:
        sections.append((f"Static: {s.name}", facts(_static_facts(s).items())))
        sections.append(("", line(s)))
        text = "Shaded: the linear range, the widest in which no point lies more than 1 % of full scale off the line. "
        text += "Below: what a point lies off it; points outside the range may leave the panel. "
        sections.append(("", note(text + (_static_note(c) if c.sensor else ""))))
        head = [f"{a.name}{', ' if a.unit else ''}{a.unit}" for a in s.axes]
        sections.append(("", table((*head, "off the line\n% of full scale", "linear"), _points(s))))
    for d in c.dynamic:
        sections.append((f"Dynamic: {d.name}", facts(_dynamic_facts(d).items())))
        sections.append(("", bode(d)))
        text = "Estimate over displacement at the lines of a periodic motion; shaded: 95 % intervals. "
        if d.found.polarity < 0:
            text += "The estimate is a gap, which falls as the displacement rises: that half turn is taken out. "
        text += "Dashed: a pure delay of the length found. " + _dynamic_note(c)
        sections.append(("", note(text)))
    made = {"Source": c.source, "Version": version("maglev-workbench")}
    if c.rig is not None:
        made = {"Rig": c.rig.name, **made}
    if c.sensor is not None:
        peak = f"{1e6 * PEAK * c.sensor.gap:g} µm"
        motion = f"steps; every {FUNDAMENTAL:g} Hz up to {TOP:g} Hz, {peak} peak, {PERIODS} periods"
        made = made_by(c.rig, c.sensor, Source=c.source, Motion=motion, Seed=0)
    return page("Calibration of the sensed gap", calibrate_summary(c), sections, made)


def _static_facts(s: Static) -> dict[str, str]:
    x, y = s.axes
    low, high = s.found.linear_range
    ends = (s.found.saturated_below, s.found.saturated_above)
    seen = [f"{side} {_with_unit(v, x)}" for side, v in zip(("below", "above"), ends, strict=True) if v is not None]
    return {
        "gain": _gain(s),
        "offset": _with_unit(s.found.offset, y),
        "linear range": f"{_with_unit(low, x)} to {_with_unit(high, x)}",
        "linearity error": f"{number(100 * s.found.linearity_error, 2)} % of full scale, "
        f"{_with_unit(s.found.largest_deviation, y)}",
        "saturated": " and ".join(seen) or "not seen",
        "points": str(s.displacement.size),
    }


def _dynamic_facts(d: Dynamic) -> dict[str, str]:
    f = d.found.frequency
    found = {
        "delay": f"{_delay(d)} µs (of the pure delay that fits best)",
        "gain": f"{d.found.gain:.4f}" + (", falling with the displacement" if d.found.polarity < 0 else ""),
        "bandwidth": f"{_bandwidth(d)} (3 dB below the gain)",
    }
    for at, (lag, half) in lags(d).items():
        delay = f"{number(lag / 360 / at * 1e6)} µs"
        found[f"lag at {at:g} Hz"] = f"{with_interval(lag, lag - half, lag + half)}°, {delay}"
    return {**found, "lines": f"{f.size} from {f[0]:.4g} to {f[-1]:.4g} Hz, {d.periods} periods"}


def _static_note(c: Calibration) -> str:
    sensor = c.sensor
    low, high = (1e3 * g for g in sensor.estimator.gap_range)
    return (
        f"The estimator searches {low:g} to {high:g} mm and rests on the end when the gap goes beyond. Reading: "
        f"{reading_text(sensor)}. The dissertation's Table 6.1 is linear to 0.49 mm with 449 mV/mm within 0.39 %; its "
        "0.43 V/mm and 2.4 % count a saturated point. `maglev selfsense calibrate table.csv` reads such a table."
    )


def _dynamic_note(c: Calibration) -> str:
    if c.sensor is None:
        return ""
    lag, _ = lag_at(c.dynamic[0], MEASURED_AT)
    return (
        "Black (white on a dark screen): "
        "the linear model. The best delay is that of the higher frequencies, where most of the phase is; low "
        f"ones lag a little longer. The dissertation measured {MEASURED_LAG:g}° at {MEASURED_AT:g} Hz, a delay of "
        f"556 µs, and left it unexplained: the estimator simulated here lags {number(lag)}° there and does not explain "
        f"it either. The dissertation's simulation lagged {TOP_LAG:g}° at 4 kHz; the gains here are those with the "
        "most phase margin at the lag that the rig asks for, see `maglev selfsense design`."
    )


def _points(s: Static) -> list[tuple[str, str, str, str]]:
    low, high = s.found.linear_range
    rows = zip(s.displacement, s.output, deviation(s), strict=True)
    x, y = s.axes
    return [
        (_cell(v, x), _cell(w, y), f"{round(100 * e, 2) + 0.0:.2f}", "yes" if low <= v <= high else "no")
        for v, w, e in rows
    ]


def _cell(value: float, axis: Axis) -> str:
    return f"{value * axis.factor:.{4 if axis.unit == 'mm' else 2}f}" if axis.unit else f"{value:.5g}"


def _gain(s: Static) -> str:
    x, y = s.axes
    scale = y.factor / x.factor
    low, high = (scale * v for v in gain_interval(s))
    unit = f" {y.unit}/{x.unit}" if x.unit else f" of {y.name} per {x.name}"
    return with_interval(scale * s.found.gain, low, high) + unit


def _delay(d: Dynamic) -> str:
    c = d.found
    return with_interval(*(1e6 * v for v in (c.delay, c.delay_low, c.delay_high)))


def _bandwidth(d: Dynamic) -> str:
    found = d.found.bandwidth
    return f"{number(found)} Hz" if np.isfinite(found) else f"{number(surely_within(d), 4)} Hz or more"


def _with_unit(value: float, axis: Axis) -> str:
    return f"{number(value * axis.factor)} {axis.unit}".strip()
