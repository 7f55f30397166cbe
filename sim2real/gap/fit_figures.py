"""How well a fit simulates records, in figures that need no nominal rig to compare with."""

from dataclasses import dataclass

import numpy as np

from sim2real.compared.problem import Part, Problem
from sim2real.recorded.open_record import OpenRecord


@dataclass(frozen=True)
class Figures:
    """How well a fit simulates records, without reference to the nominal rig.

    Attributes:
        chi_square: Of the whitened residual per degree of freedom; 1 where only noise is left.
        residual_rms: Of the reading, in the compared lines, m.
        predicted: Share of the motion's power in these lines that the simulation predicts.
    """

    chi_square: float
    residual_rms: float
    predicted: float


def _reading(part: Part, opened: np.ndarray) -> np.ndarray:
    """What residuals (outputs, axes, used) of the opened loop are in the reading itself, (axes, used)."""
    return part.opened.at(part.used).displacement(opened)


def motion(part: Part) -> float:
    y = _reading(part, part.measured[..., part.used])
    record = part.record
    if not isinstance(record, OpenRecord):
        y = record.mean("displacement")[:, part.used]
    return _rms(y)


def _rms(amplitudes: np.ndarray) -> float:
    """Rms of a series of these amplitudes (axes, lines)."""
    return float(np.sqrt(np.sum(abs(amplitudes) ** 2) / 2))


def figures(problem: Problem, residual: np.ndarray) -> Figures | None:
    """How well a simulation with this whitened residual (K,) predicts the records; None where it touches down."""
    if not np.isfinite(residual).all():
        return None
    left = moved = 0.0
    for part in problem.parts:
        r = residual[part.place].reshape(*part.measured.shape[:2], -1)
        off = _reading(part, r * part.noise[..., part.used] / np.sqrt(2))
        left, moved = left + _rms(off) ** 2, moved + motion(part) ** 2
    rms = float(np.sqrt(left / len(problem.parts)))
    return Figures(float(np.mean(abs(residual) ** 2) / 2), rms, 1 - left / moved if moved else 0.0)
