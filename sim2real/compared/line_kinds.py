"""Which lines of a recording are compared, and what drives each of them."""

import numpy as np

from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record

# Detection lines are used up to DENSE_REACH times the DENSE quantile of the driven lines.
DENSE, DENSE_REACH = 0.75, 1.2
# What drives a line, the kind of a detection line, or the means of a mass at rest.
KINDS = ("force", "current", "reference", "even", "odd", "rest")


def informative(record: Record | OpenRecord) -> np.ndarray:
    """Lines (n,) worth fitting: the driven ones, and detection lines as far as the driven ones are dense.

    Lines on which tones of known origin would lie are left out.
    """
    if isinstance(record, OpenRecord):
        return record.excited
    reach = DENSE_REACH * np.quantile(record.lines[record.excited], DENSE)
    return (record.excited | (record.lines <= reach)) & ~record.masked


def line_kinds(record: Record | OpenRecord) -> np.ndarray:
    """Index into KINDS of every line (axes, n): what drives it along that axis, or else along the other."""
    kinds = np.where(record.lines % 2 == 0, KINDS.index("even"), KINDS.index("odd"))
    kinds = np.repeat(kinds[None], record.axes, axis=0)
    for place, on in record.driven.items():
        kinds[:, on.any(axis=0)] = KINDS.index(place)
    for place, on in record.driven.items():
        kinds[on] = KINDS.index(place)
    return kinds
