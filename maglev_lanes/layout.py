"""Layout of a lane block: LANES consecutive values per variable, and rows that are named once, with computed offsets.

Constant strides allow the compiler to turn the loops over lanes into full-width vector instructions.
"""

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

Index = TypeVar("Index", int, np.ndarray)

LANES = 16
FAR = (1 << 40) - 1  # beyond every index: as a mask of one it tells the compiler that none is negative
# Assumptions on floating-point arithmetic that the compiler may make. Infinities and nans keep their meaning.
FAST = {"contract", "nsz", "arcp", "reassoc"}


def rows_after(end: int, names: str) -> tuple[int, ...]:
    """Flat offsets (row times LANES) of named rows that follow each other.

    Args:
        end: offset behind the rows declared before, 0 for the first ones.
        names: separated by blanks; `NAME[3]` is an array of three consecutive rows.

    Returns:
        The offset of each name, and last the offset behind all of them.
    """
    offsets = [end]
    for name in names.split():
        _, _, length = name.partition("[")
        offsets.append(offsets[-1] + LANES * int(length.rstrip("]") or 1))
    return tuple(offsets)


def row(offset: Index) -> Index:
    """Index of the row at a flat offset (or at each of an array of them), in an array (rows, lanes)."""
    return offset // LANES


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Uninitialised doubles that start at a cache line: a vector load across two cache lines takes twice the time."""
    count = int(np.prod(shape))
    raw = np.empty(count + 8)
    start = (-raw.ctypes.data % 64) // 8
    return raw[start : start + count].reshape(shape)


class LaneRows:
    """Values of lanes (rows, n) that are read and written by the flat offsets of their rows.

    Args:
        values: array (rows, n), shared with the caller.
    """

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    def __getitem__(self, offset: int) -> np.ndarray:
        return self.values[row(offset)]

    def __setitem__(self, offset: int, values: ArrayLike) -> None:
        """Write one row, of values (n,) or a number, or several rows, of values (rows, n)."""
        values = np.asarray(values, dtype=float)
        if values.ndim < 2:
            self.values[row(offset)] = values
        else:
            self.values[row(offset) : row(offset) + len(values)] = values
