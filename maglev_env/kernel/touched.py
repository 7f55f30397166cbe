"""The rows of a lane that a structure's step uses, found by running it in plain Python on numbers nobody knows."""

from functools import cache
from random import Random
from typing import Any

import numpy as np

from maglev_env.kernel.layout import AXIS, filter_size
from maglev_env.kernel.single import lane_stepper
from maglev_env.kernel.structure import Structure
from maglev_lanes.layout import LANES, row

SAMPLES = 3  # of a trial
SLOTS = (2, 8)  # commands kept: the shortest history is read in another way than longer ones
TRIALS = 32  # of each; a branch inside two others is missed once in 1e5


class _Unknown:
    """A number of which nothing is known: all that is computed from it is unknown, and comparisons are tossed up."""

    def __init__(self, coin: Random) -> None:
        self._coin = coin

    def _same(self, *others: Any) -> "_Unknown":
        return self

    def _toss(self, *others: Any) -> bool:
        return self._coin.random() < 0.5

    def __array_ufunc__(self, function: np.ufunc, method: str, *inputs: Any, **options: Any) -> "bool | _Unknown":
        return self._toss() if function in (np.less, np.less_equal, np.greater, np.greater_equal) else self

    def __int__(self) -> int:
        return 0

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _same
    __neg__ = __pos__ = __abs__ = __pow__ = __rpow__ = _same
    __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _toss  # type: ignore[assignment]
    __hash__ = None  # type: ignore[assignment]


class _Unknowns:
    """As many unknown numbers as asked for, with note of which are read and written."""

    def __init__(self, coin: Random, size: int = 0) -> None:
        self.size, self._number = size, _Unknown(coin)
        self.read: set[int] = set()
        self.written: set[int] = set()

    def __getitem__(self, at: Any) -> _Unknown:
        self.read.add(int(at))
        return self._number

    def __setitem__(self, at: Any, value: Any) -> None:
        self.written.add(int(at))


@cache
def touched_rows(structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the rows that are used at all, and those of them that are written, both in order.

    Args:
        structure: without self-sensors.
    """
    step, axes, coin = lane_stepper(structure), structure.axes, Random(0)
    x = _Unknowns(coin, axes * (AXIS + filter_size(structure.controller_order, structure.of_error)))
    wave, seeds = np.ones(axes * SAMPLES), np.zeros(axes * LANES, np.uint64)
    out = _Unknowns(coin, SAMPLES * axes * len(structure.channels) * LANES)
    with np.errstate(over="ignore"):  # of the random numbers
        for slots in SLOTS * TRIALS:
            history = _Unknowns(coin, axes * slots * LANES)
            step(x, seeds, history, slots * LANES, 0, True, wave, wave, wave, out)
    written = np.unique([row(at) for at in x.written])
    return np.union1d(written, [row(at) for at in x.read]), written
