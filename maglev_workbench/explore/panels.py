"""The panels of the page as data: what stands on their axes, and the traces of every layer of curves."""

import csv
import io
from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estimation.iso_14839 import iso_14839_3_zone
from estimation.normal import NORMAL_95
from estimation.stability_margins import loop_gain
from maglev_env.evaluation.identification import Identification
from maglev_env.rig.goal import Requirement
from maglev_env.rig.rig import Rig
from maglev_workbench.explore.curves import LoopCurves
from maglev_workbench.explore.goal_bars import Tested, followed
from maglev_workbench.explore.quantities import UnitSystem, labelled, shown
from maglev_workbench.page import ISO_LIMITS, number


@dataclass(frozen=True)
class Panel:
    """One diagram.

    Args:
        title: above it.
        x, y: quantity and SI unit of the axes.
        x_log, y_log: whether they are logarithmic.
        marks: horizontal lines, value in SI and label.
        joined: whether what was simulated is a line, not points.
    """

    title: str
    x: tuple[str, str]
    y: tuple[str, str]
    x_log: bool = True
    y_log: bool = False
    marks: tuple[tuple[float, str], ...] = ()
    joined: bool = False


_FREQUENCY = ("Frequency", "Hz")
PANELS: Mapping[str, Panel] = {
    "gain": Panel("Loop gain |L|", _FREQUENCY, ("|L|", ""), y_log=True, marks=((1.0, ""),)),
    "phase": Panel("Phase of L", _FREQUENCY, ("Phase", "deg"), marks=((-180.0, "-180°"),)),
    "nyquist": Panel("Nyquist diagram; circles: |S| = 3, 4, 5", ("Re L", ""), ("Im L", ""), x_log=False),
    "sensitivity": Panel(
        "Sensitivity |S| and zones of ISO 14839-3", _FREQUENCY, ("|S|", ""), y_log=True, marks=tuple(ISO_LIMITS.items())
    ),
    "step": Panel("After a step of the load", ("Time", "s"), ("Displacement per force", "m/N"), x_log=False),
    "stiffness": Panel("Stiffness", _FREQUENCY, ("Stiffness", "N/m")),
    "damping": Panel("Damping", _FREQUENCY, ("Damping", "N s/m"), marks=((0.0, ""),)),
    "load": Panel("The load is put on", ("Time", "s"), ("Displacement", "m"), x_log=False, joined=True),
    "lift_off": Panel("Lift-off", ("Time", "s"), ("Displacement", "m"), x_log=False, joined=True),
}
if [iso_14839_3_zone(limit) for limit in ISO_LIMITS] != ["B", "C", "D"]:
    raise ImportError("the limits drawn are not those of ISO 14839-3")
NYQUIST = ((-4.5, 1.5), (-3.0, 3.0))  # the part of the plane around -1 that is shown
Curve = Mapping[str, np.ndarray]  # in SI: x and y, and where they are known low, high (of y), from and to (of x)


def panels_data(rig: Rig, units: UnitSystem) -> dict[str, Any]:
    """Titles, labels and marks of all panels for the page.

    The y axes of stiffness and damping follow the curves from a quarter of the lowest target frequency upward: below,
    the integrator's share of the damping grows without bound.
    """
    fit_from = rig.target.band[0] / 4 if rig.target.band else 0.0
    found, events = {}, followed(rig)
    for name, panel in PANELS.items():
        if panel.joined and name not in events:
            continue
        xu, (yf, yu) = shown(panel.x[1], units)[1], shown(panel.y[1], units)
        found[name] = {
            "title": panel.title + (f", {_condition(events[name], units)}, simulated" if panel.joined else ""),
            "joined": panel.joined,
            "x": labelled(panel.x[0], xu),
            "y": labelled(panel.y[0], yu),
            "xLog": panel.x_log,
            "yLog": panel.y_log,
            "marks": [[value * yf, label] for value, label in panel.marks],
            "range": NYQUIST if name == "nyquist" else None,
            "circles": list(ISO_LIMITS) if name == "nyquist" else [],
            "fitFrom": fit_from if name in ("stiffness", "damping") else -1e300,
        }
    return found


def _condition(requirement: Requirement, units: UnitSystem) -> str:
    """The size of an event for a title: "0.786 N"."""
    condition = requirement.quantity.condition
    factor, unit = shown(condition[1] if condition else "", units)
    return f"{number(requirement.size * factor)} {unit}"


def event_curves(found: Tested) -> dict[str, Curve]:
    """The displacement over time in the events of the large-signal test, by panel, in SI."""
    return {name: {"x": times, "y": displacement} for name, (times, displacement) in found.events.items()}


def model_curves(found: LoopCurves) -> dict[str, Curve]:
    """The curves of the linear model by panel, in SI."""
    f, loop = found.frequency, found.loop_gain
    curves: dict[str, Curve] = _of_loop(f, loop)
    if found.sensitivity is not None:
        curves["sensitivity"] = {"x": f, "y": np.abs(found.sensitivity)}
    if found.times is not None and found.step is not None:
        curves["step"] = {"x": found.times, "y": found.step}
    if found.lines is not None and found.stiffness is not None and found.damping is not None:
        curves["stiffness"] = {"x": found.lines, "y": found.stiffness}
        curves["damping"] = {"x": found.lines, "y": found.damping}
    return curves


def identified_curves(found: Identification) -> dict[str, Curve]:
    """What a recording shows by panel, in SI: bands with 95 % intervals, and the loop at its injection lines.

    Where a current stood for the force, its bands are those of the rotor without controller, which no panel shows.
    """
    sure = [b for b in found.bands if b.informative and found.actuator is None]
    centre = np.array([(b.f_lo + b.f_hi) / 2 for b in sure])
    curves: dict[str, Curve] = {}
    for name in ("stiffness", "damping"):
        ends = np.array([getattr(b, f"{name}_ci") for b in sure]).reshape(-1, 2)
        value = np.array([getattr(b, name) for b in sure])
        span = {"from": np.array([b.f_lo for b in sure]), "to": np.array([b.f_hi for b in sure])}
        curves[name] = {"x": centre, "y": value, "low": ends[:, 0], "high": ends[:, 1], **span}
    if found.stability is not None:
        f, s = found.stability.frequency, found.stability.sensitivity
        good = np.isfinite(s) & (s != 0)
        curves |= _of_loop(f[good], loop_gain(s[good]))
        half = NORMAL_95 * np.sqrt(found.stability.variance / 2)  # of |S|, where noise is small
        size = np.abs(s)
        curves["sensitivity"] = {"x": f, "y": size, "low": np.maximum(size - half, 1e-3), "high": size + half}
    return curves


def _of_loop(frequency: np.ndarray, loop: np.ndarray) -> dict[str, Curve]:
    phase = np.degrees(np.unwrap(np.angle(loop)))
    phase -= 360 * np.ceil(phase[0] / 360) if phase.size else 0.0  # so that it begins in -360 .. 0
    return {
        "gain": {"x": frequency, "y": np.abs(loop)},
        "phase": {"x": frequency, "y": phase},
        "nyquist": {"x": np.real(loop), "y": np.imag(loop)},
    }


def as_data(curves: Mapping[str, Curve], units: UnitSystem) -> dict[str, dict[str, str]]:
    """Curves in the units of the page, each array as base64 of 32-bit floats, which a browser reads at once."""
    found = {}
    for name, curve in curves.items():
        of_x, of_y = shown(PANELS[name].x[1], units)[0], shown(PANELS[name].y[1], units)[0]
        along = ("x", "from", "to")
        found[name] = {key: _base64(values * (of_x if key in along else of_y)) for key, values in curve.items()}
    return found


def _base64(values: ArrayLike) -> str:
    return b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()


def csv_text(curves: Mapping[str, Mapping[str, Curve]], units: UnitSystem) -> str:
    """All curves as one table with the columns layer, curve, x, x_unit, y, y_unit, low, high.

    Args:
        curves: by layer ("model", "identified", "measured"), then by panel.
        units: of the table.
    """
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")  # a layer may be called "run1.npz, x"
    writer.writerow(("layer", "curve", "x", "x_unit", "y", "y_unit", "low", "high"))
    for layer, panels in curves.items():
        for name, curve in panels.items():
            (xf, xu), (yf, yu) = shown(PANELS[name].x[1], units), shown(PANELS[name].y[1], units)
            for i, x in enumerate(curve["x"]):
                ends = [f"{curve[end][i] * yf:.9g}" if end in curve else "" for end in ("low", "high")]
                writer.writerow((layer, name, f"{x * xf:.9g}", xu, f"{curve['y'][i] * yf:.9g}", yu, *ends))
    return table.getvalue()
