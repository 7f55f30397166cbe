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
    samples, found = displacement.shape[1], {}
    along = legendre.legvander(np.linspace(-1.0, 1.0, samples), max(DEGREES)).T
    for axis, size in enumerate(displacement.std(axis=1)):
        for degree in DEGREES if size > 0 else ():
            drifting = np.zeros((3, record.axes, samples))  # displacement, current and command
            drifting[0, axis] = size * along[degree]
            read = parts_of(record, loop, drifting)["displacement"]
            column = np.zeros((len(outputs), record.axes, record.frequency.size), complex)
            for name, lines in read.items():
                if name in outputs:
                    column[outputs.index(name)] = record.windows.project(lines).reshape(record.axes, -1)
            found[f"drift of degree {degree} along axis {axis} of {record.name}"] = column
    return found
