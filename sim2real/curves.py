"""Responses of judged recordings, measured and simulated, for the figures of a diagnosis."""

from dataclasses import dataclass

import numpy as np

from maglev_env.loop.axes import AXES
from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.problem import Part
from sim2real.recorded.open_record import OpenRecord
from sim2real.result import Diagnosis
from sim2real.search.hypotheses import TONES

FEWEST = 3  # lines that a curve needs


@dataclass(frozen=True)
class Curve:
    """A closed-loop response of a judged recording, measured and simulated.

    Attributes:
        kind: "receptance" (m/N, displacement over force) or "sensitivity" (command over injection).
        record: Name of the recording.
        axis: "x" or "y"; "" for a one-axis rig.
        frequency: Frequencies (n,), Hz.
        measured: Measured response (n,).
        sd: Standard deviation (n,) of the complex value, E|n|^2 = sd^2.
        nominal: Response of the nominal rig (n,); nan where the rotor touches down.
        corrected: Response of the corrected rig (n,); nan where the rotor touches down.
    """

    kind: str
    record: str
    axis: str
    frequency: np.ndarray
    measured: np.ndarray
    sd: np.ndarray
    nominal: np.ndarray
    corrected: np.ndarray

    def distance(self, simulated: np.ndarray) -> np.ndarray:
        """Distance of a simulated curve in units of the noise; its rms is 1 where the curves differ by noise alone."""
        return abs(simulated - self.measured) / self.sd


def curves(diagnosis: Diagnosis) -> tuple[Curve, ...]:
    """Receptance and sensitivity of each axis, from the first judged recordings that show them."""
    found: dict[tuple[str, str], Curve] = {}
    corrected = diagnosis.corrected
    # A tone is not a line of the excitation: with it, a simulated period would not repeat.
    lines = Point({n: v for n, v in corrected.effects.items() if n not in TONES}, corrected.changes, corrected.dithered)
    for part in diagnosis.judged.parts:
        shown = _shown(part)
        if all(key in found for key in shown):
            continue
        nominal, after = part.predictor.smoothed([NOMINAL, lines])
        for (kind, axis), on in shown.items():
            if (kind, axis) not in found:
                found[kind, axis] = _curve(part, kind, axis, on, nominal, after)
    return tuple(found[key] for key in sorted(found))


def _shown(part: Part) -> dict[tuple[str, str], np.ndarray]:
    """Lines (n,) of each response that a part shows, by (kind, axis)."""
    record, found = part.record, {}
    if isinstance(record, OpenRecord) and record.upstream:
        return found  # another controller stands in, and the loop that was measured is not known
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
