"""The answer in sentences: whether the loop is stable, and by how much."""

from dataclasses import dataclass
from math import isnan, log
from typing import Literal

import numpy as np

from estimation.gain_margin import gain_factors
from estimation.iso_14839 import iso_14839_3_zone
from estimation.max_likelihood import maximum_likelihood
from maglev_env.evaluation.identification import Identification
from maglev_workbench.explore.curves import LoopCurves
from maglev_workbench.explore.quantities import UnitSystem, shown
from maglev_workbench.explore.setting import Setting, axis_name
from maglev_workbench.page import number, with_interval

ZONES = {
    "A": "as of a new machine",
    "B": "acceptable for long operation",
    "C": "not for long operation",
    "D": "likely to cause damage",
}  # what ISO 14839-3 says of them


@dataclass(frozen=True)
class Sentence:
    """One sentence of the answer, and whether it is good news."""

    text: str
    kind: Literal["good", "fair", "bad", "plain"]


def answer(found: LoopCurves, setting: Setting) -> list[Sentence]:
    """What the linear model says of the loop, the most important first."""
    rate = setting.experiment.rig.control_rate
    if not found.stable:
        doubled = log(2) / (log(found.radius) * rate) if found.radius > 1 else float("inf")
        return [
            Sentence(f"Unstable: a small motion doubles every {_with_unit(doubled, 's', setting.units)}.", "bad"),
            Sentence("Only the loop gain is shown; the other curves belong to a loop that holds the rotor.", "plain"),
        ]
    return [*_margins(found, setting), *_coefficients(found, setting)]


def _margins(found: LoopCurves, setting: Setting) -> list[Sentence]:
    m, units = found.margins, setting.units
    assert m is not None and found.sensitivity is not None  # of a stable loop
    zone = iso_14839_3_zone(m["peak_sensitivity"])
    kind: Literal["good", "fair", "bad"] = "good" if zone == "A" else "fair" if zone == "B" else "bad"
    settled = -1 / (log(found.radius) * setting.experiment.rig.control_rate)
    peak = f"Peak |S|{axis_name(setting)} {number(m['peak_sensitivity'], 4)} at {number(m['peak_frequency'])} Hz"
    sentences = [Sentence(f"Stable. {peak}: zone {zone} of ISO 14839-3, {ZONES[zone]}.", kind)]
    gains = []
    up, down = map(float, gain_factors(found.frequency, found.sensitivity, m))
    if not isnan(up):
        gains.append(f"rise to {number(up)} times")
    if not isnan(down):
        gains.append(f"fall to {number(1 / down)} times")
    if gains:
        sentences.append(Sentence(f"The loop gain may {' or '.join(gains)} its value.", "plain"))
    if not isnan(m["phase_margin"]):
        phase = f"Phase margin {number(m['phase_margin'])}° at {number(m['phase_margin_frequency'])} Hz"
        delay = _with_unit(m["delay_margin"], "s", units)
        sentences.append(Sentence(f"{phase}; a further delay of {delay} makes it unstable.", "plain"))
    decay = _with_unit(settled, "s", units)
    return [*sentences, Sentence(f"The slowest motion decays with a time constant of {decay}.", "plain")]


def _coefficients(found: LoopCurves, setting: Setting) -> list[Sentence]:
    if found.in_target is None:
        return []
    (k, c), units, band = found.in_target, setting.units, setting.experiment.rig.target.band
    assert band is not None  # every rig has one
    return [
        Sentence(
            f"Stiffness {_with_unit(k, 'N/m', units)}, damping {_with_unit(c, 'N s/m', units)} from {band[0]:g} to "
            f"{band[1]:g} Hz.",
            "bad" if c <= 0 else "plain",
        )
    ]


def identified_answer(found: Identification, setting: Setting) -> list[Sentence]:
    """What the simulated experiment shows, with its 95 % intervals."""
    sentences = []
    if found.stability is not None:
        peak, (low, high) = (
            found.stability.margins.peak_sensitivity,
            found.stability.margins.intervals["peak_sensitivity"],
        )
        sentences.append(Sentence(f"Identified: peak |S| {with_interval(peak, low, high)} (95 %).", "plain"))
    if found.natural_frequency is not None:
        sentences.append(Sentence(f"Natural frequency {number(found.natural_frequency)} Hz.", "plain"))
    if (band := setting.experiment.rig.target.band) is not None and found.actuator is None:
        fit = maximum_likelihood(found.statistics, np.array([band]), found.mass)  # as the linear model's, and a sweep's
        factor, unit = shown("N/m", setting.units)
        k, c = (
            with_interval(*(scale * float(getattr(fit, name + end)[0]) for end in ("", "_low", "_high")))
            for name, scale in (("stiffness", factor), ("damping", 1.0))
        )
        at = f"{band[0]:g} to {band[1]:g} Hz"
        sentences.append(Sentence(f"Stiffness {k} {unit}, damping {c} N s/m from {at}.", "plain"))
    return sentences


def _with_unit(value: float, unit: str, units: UnitSystem) -> str:
    factor, name = shown(unit, units)
    return f"{number(value * factor)} {name}"
