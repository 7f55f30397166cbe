"""Do both axes of a rig move alike in every recording, so that nothing tells what one does to the other?

Where y always moves as x does, times one factor, a force on x by the motion of y is a stiffness of x. Magnets and
probes of each axis have tolerances of their own, which then take up what couples the axes.
"""

from collections.abc import Sequence

import numpy as np

from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record

CORRELATED, SAME = 0.98, 0.1  # least correlation of both displacements; largest relative change of their ratio


def driven_alike_in_words(records: Sequence[Record | OpenRecord]) -> list[str]:
    """A note where the axes of a rig with two move alike in every recording; none elsewhere."""
    ratios = [_ratio(r.series["displacement"]) for r in records if r.axes == 2]
    if not ratios or not all(abs(ratio / ratios[0] - 1) < SAME for ratio in ratios):
        return []
    return [
        "x and y move alike in every recording: what couples the axes cannot be told from magnets that differ between "
        "them, and may be taken for such a difference; drive one axis alone in a further recording"
    ]


def _ratio(displacement: np.ndarray) -> float:
    """Motion of y over that of x, of displacements (2, samples); nan where they do not move alike."""
    motion = displacement - displacement.mean(axis=1, keepdims=True)
    (xx, xy), (_, yy) = motion @ motion.T
    return float(np.copysign(np.sqrt(yy / xx), xy)) if xy**2 > CORRELATED**2 * xx * yy else float("nan")
