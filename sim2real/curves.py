"""Responses of judged recordings, measured and simulated, for the figures of a diagnosis."""

import numpy as np

from maglev_env.loop.axes import AXES
from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.problem import Part
from sim2real.curve import FEWEST, Curve
from sim2real.open_curves import open_curves
from sim2real.recorded.open_record import OpenRecord
from sim2real.result import Diagnosis
from sim2real.search.hypotheses import TONES


def curves(diagnosis: Diagnosis) -> tuple[Curve, ...]:
    """Receptance and sensitivity of each axis, from the first judged recordings that show them."""
    found: dict[tuple[str, str], Curve] = {}
    corrected = diagnosis.corrected
    # A tone is not a line of the excitation: with it, a simulated period would not repeat.
    lines = Point({n: v for n, v in corrected.effects.items() if n not in TONES}, corrected.changes, corrected.dithered)
    for part in diagnosis.judged.parts:
        if isinstance(part.record, OpenRecord):
            for curve in open_curves(part, NOMINAL, lines):
                found.setdefault((curve.kind, curve.axis), curve)
            continue
        shown = _shown(part)
        if all(key in found for key in shown):
            continue
        nominal, after = (part.predictor.smoothed([point])[0] for point in (NOMINAL, lines))
        for (kind, axis), on in shown.items():
            if (kind, axis) not in found:
                found[kind, axis] = _curve(part, kind, axis, on, nominal, after)
    return tuple(found[key] for key in sorted(found))


def _shown(part: Part) -> dict[tuple[str, str], np.ndarray]:
    """Lines (n,) of each response that a part shows, by (kind, axis)."""
    record, found = part.record, {}
    for kind, place in (("receptance", "force"), ("sensitivity", "current")):
        for axis in range(record.axes):
            on = record.driven[place][axis] & ~record.masked
            if on.sum() >= FEWEST:
                found[kind, AXES[axis] if record.axes == 2 else ""] = on
    return found


def _curve(part: Part, kind: str, axis: str, on: np.ndarray, nominal: np.ndarray, corrected: np.ndarray) -> Curve:
    record, opened = part.record, part.opened
    a, plant = AXES.index(axis) if axis else 0, opened.outputs.index("plant")
    drive = record.driving("force" if kind == "receptance" else "current")[a, on]
    closed, controller = opened.closed[a, on], opened.of_injection[a, on]

    def response(displacement: np.ndarray) -> np.ndarray:
        return displacement / drive if kind == "receptance" else 1 - controller * displacement / drive

    measured = record.mean("displacement")[a, on]
    sd = part.noise[plant, a, on] / abs(closed * drive)
    return Curve(
        kind,
        record.name,
        axis,
        record.frequency[on],
        response(measured),
        sd if kind == "receptance" else sd * abs(controller),
        response(opened.displacement(nominal)[a, on]),
        response(opened.displacement(corrected)[a, on]),
    )
