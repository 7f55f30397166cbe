"""What varies over time and has no name: tones between the lines of the drive, and bands of loud noise, in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.compared.tones_left import resolution_of
from sim2real.judgement.tones.sightings import FOREIGN, LOUD, Sighting
from sim2real.recorded.open_record import OpenRecord

SHOWN = 4  # tones that are listed
MANY = 4  # tones from which on a common distance from the lines is no chance
ALIKE = 0.2  # of what a recording resolves, within which distances from the lines are the same


@dataclass(frozen=True)
class BetweenLines:
    """What lies between the lines of the drive.

    Attributes:
        tones: Frequencies of tones of unknown origin (n,), Hz, the clearest first.
        bands: Middles of bands of loud noise, Hz, the clearest first.
        shift: Spacing of the drive's lines, and the distance of all tones from a multiple of it, Hz; None where they
            have none in common.
    """

    tones: tuple[float, ...]
    bands: tuple[float, ...]
    shift: tuple[float, float] | None

    def in_words(self) -> str:
        """For instance "tones at 3.7, 4.3, 7.7 and 8.3 Hz and 4 more", as an apposition."""
        parts = [f"{what} {_listed(at)}" for what, at in (("tones at", self.tones), ("noise around", self.bands)) if at]
        said = " and ".join(parts)
        if self.shift is None:
            return said
        spacing, off = self.shift
        return (
            f"{said}; all tones are {off:.3g} Hz from a multiple of {spacing:.4g} Hz, as where something that changes "
            f"periodically, at {off:.3g} Hz or at another such frequency, shifts the lines of the drive"
        )


def between_lines(problem: Problem, found: Sequence[Sighting]) -> BetweenLines | None:
    """What of the sightings has no known origin; None without any.

    Args:
        problem: The campaign.
        found: All sightings.
    """
    tones, bands = ([s for s in found if s.family == family] for family in (FOREIGN, LOUD))
    if not tones and not bands:
        return None
    return BetweenLines(_distinct(problem, tones), _distinct(problem, bands), _shift(problem, tones))


def _distinct(problem: Problem, found: Sequence[Sighting]) -> tuple[float, ...]:
    """Frequencies, the clearest first, each once."""
    kept: list[float] = []
    for s in sorted(found, key=lambda s: -s.chi2):
        near = resolution_of(problem.parts[s.record].record) if s.family == FOREIGN else 0.3 * s.frequency
        if all(abs(s.frequency - f) > near for f in kept):
            kept.append(s.frequency)
    return tuple(kept)


def _shift(problem: Problem, tones: Sequence[Sighting]) -> tuple[float, float] | None:
    """Spacing of the lines of recordings with periods, and the distance from its multiples that all tones have; Hz."""
    records = [problem.parts[s.record].record for s in tones]
    periodic = [(s, r) for s, r in zip(tones, records, strict=True) if not isinstance(r, OpenRecord)]
    spacings = {r.experiment.fundamental for _, r in periodic}
    if len(periodic) < MANY or len(spacings) > 1:
        return None
    (spacing,) = spacings
    off = np.array([abs(s.frequency - spacing * round(s.frequency / spacing)) for s, _ in periodic])
    middle = float(np.median(off))
    resolved = max(resolution_of(r) for _, r in periodic)
    alike = (abs(off - middle) < ALIKE * resolved).all()
    # Distances that a chance spread over half a spacing would hardly have.
    return (spacing, middle) if alike and ALIKE * resolved < middle < (0.5 - 0.1) * spacing else None


def _listed(at: Sequence[float]) -> str:
    shown = [f"{f:.4g}" for f in at[:SHOWN]]
    more = f" and {len(at) - SHOWN} more" if len(at) > SHOWN else ""
    listed = ", ".join(shown) if more or len(shown) < 2 else f"{', '.join(shown[:-1])} and {shown[-1]}"
    return f"{listed} Hz{more}"
