"""Demodulator beside estimator: console table, page and JSON."""

from dataclasses import asdict
from importlib.metadata import version
from math import hypot, pi
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.selfsense.demodulate.figures import comparison, enlarged
from maglev_workbench.commands.selfsense.demodulate.study import METHODS, Demodulation, GapError
from maglev_workbench.commands.selfsense.rig_sensor import made_by, reading_text, sampling_note
from maglev_workbench.page import note, number, page, table

if TYPE_CHECKING:
    import rich.table

_BETTER = 1.2  # ratio of the errors from which on one is called better
_HEAD = ("duty", "gap", "rms error\nµm", "mean error\nµm", "lag\ndegrees", "rms, lag\ntaken out", "rms, ideal\nreading")


def demodulate_table(d: Demodulation) -> "rich.table.Table":
    """Errors of both methods with both duties, in 80 columns."""
    from rich import box
    from rich.table import Table

    title = f"Gap of {d.rig.name} moving {_motion(d)}"
    result = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title=title)
    for name in _HEAD:
        result.add_column(name, justify="left" if name in ("duty", "gap") else "right", no_wrap=name == "gap")
    for row in _rows(d):
        result.add_row(*row)
    result.caption = f"Against the true gap, lag counted. Reading: {reading_text(d.sensor)}; ideal: neither."
    return result


def demodulate_summary(d: Demodulation) -> str:
    """Sentences on the effect of the varying duty on both gaps."""
    varying, constant = d.traces["varying"], d.traces["constant"]
    wrong, good = (varying.errors[m] for m in METHODS)
    times = f"{number(varying.ratio, 2)} times less" if varying.ratio > _BETTER else "no better"
    text = (
        f"While the duty varies by ±{d.duty_swing:g} about one half, the demodulated gap of {d.rig.name} is wrong by "
        f"{_um(wrong.rms)} µm rms ({_um(wrong.bias)} µm on average), the estimated one by {_um(good.rms)} µm: {times}"
    )
    if _noisy(d):
        ideal = varying.ideal["estimated"]
        text += (
            f", {'but' if varying.ratio <= _BETTER else 'and'} {number(varying.ideal_ratio)} times less "
            f"({_um(ideal.rms)} µm) where no noise and rounding of the current add to it"
        )
    at_half = [_um(constant.errors[m].rms) for m in METHODS]
    return f"{text}. With the duty constant they are wrong by {at_half[0]} and {at_half[1]} µm."


def demodulate_json(d: Demodulation) -> dict[str, Any]:
    """Both duties as JSON data, schema maglev-selfsense-demodulate/1, SI and degrees."""
    return plain(
        {
            "schema": "maglev-selfsense-demodulate/1",
            "version": version("maglev-workbench"),
            "rig": d.rig.name,
            "sensor": d.sensor,
            "seed": d.seed,
            "settings": {
                "frequency": d.frequency,
                "amplitude": d.amplitude,
                "duty_swing": d.duty_swing,
            },
            "duty": {
                name: {
                    **{m: _numbers(d, t.errors[m]) for m in METHODS},
                    "ratio": t.ratio,
                    "ideal_reading": {**{m: _numbers(d, t.ideal[m]) for m in METHODS}, "ratio": t.ideal_ratio},
                }
                for name, t in d.traces.items()
            },
            "closed_form": {"rms": _rms(d.closed_form), "bias": float(d.closed_form.mean())},
            "path_factor": d.path_factor,
            "current": {"simulated": d.current, "inductive": _inductive(d), "with_resistance": _resistive(d)},
        }
    )


def demodulate_page(d: Demodulation) -> str:
    """The HTML of the comparison."""
    rows = [
        *_rows(d),
        (_rows(d)[-1][0], "closed form", _um(_rms(d.closed_form)), _um(d.closed_form.mean()), "", "", ""),
    ]
    text = "Lag counted: error is what a loop would run on, less the true gap at the same instant. "
    text += f"Reading: {reading_text(d.sensor)}"
    text += "; last column: the same current read without noise and rounding. " if _noisy(d) else ". "
    sections = [
        ("Errors", table(_HEAD, rows)),
        ("", note(text + sampling_note(d.sensor))),
        ("True, demodulated and estimated gap", comparison(d)),
        ("", note(_figure_note(d))),
        ("Enlarged, where the duty is farthest from one half", enlarged(d)),
        ("", note("What is left on the demodulated gap at the PWM frequency is the low-pass filter's share of it.")),
        ("What the duty does", note(_corruption_note(d))),
        ("", note(_dissertation_note(d))),
        ("", note(_current_note(d))),
    ]
    facts = made_by(d.rig, d.sensor, Motion=_motion(d), Duty=f"1/2 ± {d.duty_swing:g}", Seed=d.seed)
    return page(f"Switching-noise demodulation on {d.rig.name}", demodulate_summary(d), sections, facts)


def _rows(d: Demodulation) -> list[tuple[str, ...]]:
    rows = []
    for name, t in d.traces.items():
        duty = "1/2" if name == "constant" else f"1/2 ± {d.duty_swing:g}"
        for m in METHODS:
            e = t.errors[m]
            cells = (_um(e.rms), _um(e.bias), number(_degrees(d, e)), _um(e.rms_without_lag), _um(t.ideal[m].rms))
            rows.append((duty, m, *cells))
    return rows


def _figure_note(d: Demodulation) -> str:
    return (
        "Left: with the duty at one half both follow the gap, the demodulated one later. Right: the duty varies at the "
        "frequency of the motion, and the demodulated gap falls short twice per period, whenever the duty leaves one "
        "half to either side; dashed: the closed form of that. The estimator's simulated inductor sees the same "
        "switching voltage, so the duty cancels. Compare the dissertation's Figures 6.9, 6.10 and 6.13."
    )


def _corruption_note(d: Demodulation) -> str:
    t = d.traces["varying"].ideal["demodulated"].bias
    rest = t - d.closed_form.mean()
    return (
        "The ripple is proportional to alpha (1 - alpha) of the duty alpha, so a demodulator calibrated at one half "
        "reads gap + core length / 2 too low by the share (2 alpha - 1)²: here "
        f"{_um(d.closed_form.mean())} µm on average and at most {_um(d.closed_form.min())} µm. The other "
        f"{_um(rest)} µm of its mean error come from the high-pass filter, which attenuates an unequal triangle "
        "otherwise than an equal one, from the few samples per PWM period and from the coil's resistance."
    )


def _dissertation_note(d: Demodulation) -> str:
    return (
        "The dissertation's closed form of the demodulator's output (eq. 6.20) is twice the simulated one: it "
        "rectifies a ripple that starts at zero, but behind a high-pass filter the ripple swings to both sides of its "
        "mean, which halves its mean magnitude. Sampled filters add a factor, which the calibration holds: "
        f"{d.path_factor:.4f} times the ripple's mean magnitude here, from the gain of the high-pass filter at the PWM "
        "frequency and its harmonics and the rectifier's few samples."
    )


def _current_note(d: Demodulation) -> str:
    return (
        f"A duty that varies by ±{d.duty_swing:g} at {d.frequency:g} Hz drives {number(d.current)} A (peak) through "
        f"this coil. By the dissertation's eq. 6.25, which leaves out the resistance, it is {number(_inductive(d))} A; "
        f"with {d.sensor.coil.resistance:g} ohm in series {number(_resistive(d))} A. A loop that needs less current "
        "varies the duty, and corrupts the demodulated gap, less."
    )


def _inductive(d: Demodulation) -> float:
    """Amplitude (A) of the current that the swing drives by D eq 6.25."""
    return 2 * d.duty_swing * d.sensor.supply.voltage / _reactance(d)


def _resistive(d: Demodulation) -> float:
    """The same with the coil's resistance."""
    return 2 * d.duty_swing * d.sensor.supply.voltage / hypot(_reactance(d), d.sensor.coil.resistance)


def _reactance(d: Demodulation) -> float:
    return 2 * pi * d.frequency * float(d.sensor.coil.inductance(d.sensor.gap))


def _numbers(d: Demodulation, e: GapError) -> dict[str, float]:
    return {**asdict(e), "lag": _degrees(d, e)}


def _degrees(d: Demodulation, e: GapError) -> float:
    return 360 * d.frequency * e.delay


def _motion(d: Demodulation) -> str:
    return f"±{1e6 * d.amplitude:g} µm at {d.frequency:g} Hz"


def _noisy(d: Demodulation) -> bool:
    return d.sensor.acquisition.noise > 0 or d.sensor.acquisition.bits > 0


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _um(value: float) -> str:
    return number(1e6 * value)
