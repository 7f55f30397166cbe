"""From the recordings of an x-y rig to its eight stiffness and damping coefficients (D eq 5.5-5.9)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimation.lines.periods import LineStatistics
from estimation.xy.planar import CONDITION_LIMIT, PlanarEstimate, RowSums, eight_coefficients, row_sums
from estimation.xy.planar_least_squares import PlanarLeastSquares, planar_least_squares
from maglev_env.evaluation.bands import band_layout
from maglev_env.evaluation.known_chain import rotor_motion
from maglev_env.loop.axes import AXES
from maglev_env.recordings.spectra import RecordedSignals, record_spectra
from maglev_env.rig.rig import Rig, axis_rig


@dataclass(frozen=True)
class PlanarIdentification:
    """What recordings of one loop show together.

    Attributes:
        bands: (b, 2), Hz.
        masses: Of x and y, kg.
        estimate: The eight coefficients; nan in bands where all recordings move x and y along one line.
        least_squares: The same by least squares.
        row_sums: What each recording shows by itself, in order.
        bearing_stiffness: (b, 2, 2), the estimate without the rig's support, taken off in x and in y; None without a
            support.
        bearing_damping: The same for the damping.
        notes: What was assumed or not available.
    """

    bands: np.ndarray
    masses: tuple[float, float]
    estimate: PlanarEstimate
    least_squares: PlanarLeastSquares
    row_sums: tuple[RowSums, ...]
    bearing_stiffness: np.ndarray | None
    bearing_damping: np.ndarray | None
    notes: tuple[str, ...]


def identify_planar(
    records: Sequence[RecordedSignals],
    rig: Rig | None,
    mass: float,
    band_width: float | None = None,
    band_overlap: float | None = None,
) -> PlanarIdentification:
    """The eight coefficients from x-y recordings made with the same controllers.

    The bands are those of `identify`. The mass (kg) is that of both axes where the rig does not give one its own.

    Raises:
        ValueError: A channel or a force excitation is missing.
    """
    if not records:
        raise ValueError("the eight coefficients need at least one recording, better two")
    spectra = [record_spectra(signals) for signals in records]
    forces = [_rotor_motion(one.force, rig) for one in spectra]
    if not all(force.lines.size for force in forces):
        raise ValueError("the eight coefficients need an excitation at the force in every recording")
    bands = band_layout(forces[0], rig, band_width, band_overlap)
    masses = (mass, mass)
    if rig is not None and rig.axes == 2:
        masses = tuple(mass * axis_rig(rig, axis).mass / rig.mass for axis in range(2))
    estimate = eight_coefficients(forces, bands, masses)
    notes = list(dict.fromkeys(note for one in spectra for note in one.notes))
    refused = ~estimate.identifiable
    if refused.any():
        worst = estimate.condition[refused].min()
        number = f"condition number {worst:.3g} or more" if np.isfinite(worst) else "what lies across it is noise"
        which = "no band" if refused.all() else f"{(~refused).sum()} of {len(bands)} bands"
        notes.append(
            f"eight coefficients can be told in {which}: elsewhere x and y move along one line ({number}; at most "
            f"{CONDITION_LIMIT:g} is good enough), and only row sums along it are certain. "
            "Record again with the excitation turned, 90 degrees best, or drive x and y on lines of their own"
        )
    bearing = [None, None]
    supports = [] if rig is None else [axis_rig(rig, axis) for axis in range(2)]
    if any(own.support_stiffness for own in supports):
        k, c = np.array([(own.support_stiffness, own.support_damping) for own in supports]).T
        bearing = [estimate.stiffness - np.diag(k), estimate.damping - np.diag(c)]
    return PlanarIdentification(
        bands,
        masses,
        estimate,
        planar_least_squares(forces, bands, masses),
        tuple(row_sums(force, bands, masses) for force in forces),
        *bearing,
        tuple(notes),
    )


def _rotor_motion(force: LineStatistics, rig: Rig | None) -> LineStatistics:
    """The lines of both axes without the lags of their nominal probes."""
    for axis, name in enumerate(AXES if rig is not None and rig.axes == 2 else ()):
        force = rotor_motion(force, axis_rig(rig, axis), f"_{name}")
    return force
