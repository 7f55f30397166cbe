"""Where a suspended mass rests: levels of displacement and current, found in recordings."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force, linearise
from maglev_env.rig.rig import Rig
from sim2real.recorded.along_motion import NEAREST

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


def levels_of(displacement: np.ndarray, current: np.ndarray, rig: Rig, falls: float) -> Levels:
    """The blocks of a record in which the mass rests in the mean.

    It need not stand still: the mean pull along a motion, less what accelerates the mass, is that of a level. Means are
    weighted by a Hann window, whose second derivative tells the same mean of the acceleration exactly. The acceleration
    in a plain mean is the change of velocity between both ends, which a fast motion hides: all blocks of a multisine
    would look at rest, and slopes of current over displacement were off by a third.

    Args:
        displacement, current: (samples,), m and A.
        rig: nominal; its law says how little a motion and an acceleration take of the mean current.
        falls: acceleration of gravity, m per sample squared.
    """
    law = force_law(rig)
    weight, gain = rig.mass * rig.gravity, linearise(law)[0]
    size = max(displacement.size // BLOCKS, LEAST)
    turn = 2 * np.pi * (np.arange(size) + 0.5) / size
    window, curvature = (1 - np.cos(turn)) / size, (2 * np.pi / size) ** 2 * np.cos(turn) / size
    found = []
    for begin in range(0, displacement.size - size + 1, size):
        both = np.stack([displacement[begin : begin + size], current[begin : begin + size]])
        means = np.array([[p.mean() for p in np.array_split(s, PARTS)] for s in both])
        accelerated = float(curvature @ both[0]) / falls
        if means[0].std() < SMALL * rig.gap and abs(accelerated) < BALANCED:
            level, mean = both @ window
            place = np.clip(both[0], -NEAREST * rig.gap, NEAREST * rig.gap)
            along = float(window @ force(law, place, both[1]) - force(law, level, mean))
            spread = means.std(axis=1, ddof=1) / np.sqrt(PARTS)
            found.append((level, mean + (along - accelerated * weight) / gain, *spread))
    return Levels(*np.array(found).reshape(-1, 4).T, np.zeros(len(found), int))


def joined(levels: Sequence[Levels]) -> Levels:
    """The levels of several recordings together."""
    numbered = [replace(own, recording=np.full(own.count, number)) for number, own in enumerate(levels)]
    return Levels(*(np.concatenate([getattr(own, f.name) for own in numbered]) for f in fields(Levels)))
