"""Arrays that other processes read where they lie."""

import os

import numpy as np
import pytest

from maglev_lanes import shared_pool
from maglev_lanes.shared_pool import Place


def nothing():
    """What a process does at first."""


def read(place: Place) -> tuple[int, float]:
    """In which process this runs, and the sum of an array."""
    return os.getpid(), float(place.array().sum())


def test_processes_read_parts_of_arrays_and_memory_is_used_again(monkeypatch):
    with shared_pool.shared_pool(2, nothing) as pool:
        whole = pool.empty((4, 3, 5))
        whole[:] = np.arange(60.0).reshape(4, 3, 5)
        places = [pool.place(part) for part in whole]
        found = list(pool.map(read, places))
        assert [total for _, total in found] == [float(part.sum()) for part in whole]
        assert os.getpid() not in {process for process, _ in found}

        other = pool.empty((50,))
        assert pool.place(other).memory != places[0].memory  # the first is still needed
        pool.forget({places[0].memory})
        again = pool.empty((59,))
        again[:] = 1.0
        assert pool.place(again).memory == places[0].memory
        assert next(pool.map(read, [pool.place(again)]))[1] == 59.0
        assert pool.place(pool.empty((60,))).memory != places[0].memory
        assert pool.place(np.zeros(3)) is None

        monkeypatch.setattr(shared_pool, "_room", lambda: 1000.0)
        assert pool.place(pool.empty((125,))) is not None
        without = pool.empty((126,))
        assert without.shape == (126,) and pool.place(without) is None
    with pytest.raises(FileNotFoundError):
        places[0].array()
