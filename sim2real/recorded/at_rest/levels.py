"""Where a suspended mass rests: levels of displacement and current, found in recordings."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

BLOCKS, LEAST, PARTS = 40, 25, 5  # blocks of a record, least samples of a block, and parts of it
SMALL = 0.02  # of the gap: standard deviation of the parts' means, up to which the force law is straight
BALANCED = 5e-3  # of the weight: what the mean acceleration of a block may take


@dataclass(frozen=True)
class Levels:
    """Where a mass rested.

    Args:
        displacement: (n,), m from the rig's centre.
        current: (n,), A from the rig's bias.
        displacement_sd, current_sd: (n,), standard deviations of these means.
        recording: (n,), number of the recording.
    """

    displacement: np.ndarray
    current: np.ndarray
    displacement_sd: np.ndarray
    current_sd: np.ndarray
    recording: np.ndarray

    @property
    def count(self) -> int:
        return self.displacement.size

    def of(self, chosen: np.ndarray) -> "Levels":
        """Those of a mask (n,)."""
        return Levels(*(getattr(self, f.name)[chosen] for f in fields(self)))


def levels_of(displacement: np.ndarray, current: np.ndarray, gap: float, falls: float) -> Levels:
    """The blocks of a record in which the mass rests in the mean.

    It need not stand still: where it moves little, the mean pull is that at the mean displacement, and it carries the
    weight as far as nothing accelerates over the whole block.

    Args:
        displacement, current: (samples,), m and A.
        gap: m.
        falls: acceleration of gravity, m per sample squared.
    """
    size = max(displacement.size // BLOCKS, LEAST)
    found, at = [], np.arange(PARTS) * size / PARTS
    for begin in range(0, displacement.size - size + 1, size):
        part = slice(begin, begin + size)
        means = np.array([[p.mean() for p in np.array_split(s[part], PARTS)] for s in (displacement, current)])
        accelerated = abs(2 * np.polyfit(at, means[0], 2)[0])
        if means[0].std() < SMALL * gap and accelerated < BALANCED * falls:
            found.append((*means.mean(axis=1), *(means.std(axis=1, ddof=1) / np.sqrt(PARTS))))
    return Levels(*np.array(found).reshape(-1, 4).T, np.zeros(len(found), int))


def joined(levels: Sequence[Levels]) -> Levels:
    """The levels of several recordings together."""
    numbered = [replace(own, recording=np.full(own.count, number)) for number, own in enumerate(levels)]
    return Levels(*(np.concatenate([getattr(own, f.name) for own in numbered]) for f in fields(Levels)))
