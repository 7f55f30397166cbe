"""A reading that drifts over an open record, as a probe does that becomes warm.

Windows of lines are compared without what is smooth over the line number. The transform of a slow drift is not smooth
at the lowest lines, where it falls off as one over the line number, its square or its cube. How large it is, nobody
knows: its first shapes over the length of the record are left out of the comparison.
"""

import numpy as np
from numpy.polynomial import legendre

from sim2real.recorded.open_evidence import parts_of
from sim2real.recorded.open_loop import Loop
from sim2real.recorded.open_record import OpenRecord

DEGREES = (1, 2, 3)  # of the polynomials of time: slower than half a turn of a sine, a drift is hardly anything else


def drift_columns(record: OpenRecord, loop: Loop, outputs: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Nuisances of one standard deviation, as columns (outputs, axes, n) by name: a drift as large as the motion.

    Args:
        record: the record.
        loop: its loop.
        outputs: that are compared.
    """
    displacement = record.series["displacement"]
    along = legendre.legvander(np.linspace(-1.0, 1.0, displacement.shape[1]), max(DEGREES)).T
    of_all_axes = np.zeros((len(DEGREES), len(outputs), record.axes, record.frequency.size), complex)
    for degree, shown in zip(DEGREES, of_all_axes, strict=True):
        drifting = np.zeros((3, *displacement.shape))  # displacement, current and command
        drifting[0] = displacement.std(axis=1)[:, None] * along[degree]
        for name, lines in parts_of(record, loop, drifting)["displacement"].items():
            if name in outputs:
                shown[outputs.index(name)] = record.windows.project(lines).reshape(record.axes, -1)
    found = {}
    for axis in range(record.axes):
        for degree, shown in zip(DEGREES, of_all_axes, strict=True):
            column = np.zeros_like(shown)
            column[:, axis] = shown[:, axis]
            found[f"drift of degree {degree} along axis {axis} of {record.name}"] = column
    return found
