"""Processes on this machine that read large arrays where this process wrote them, without a copy."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from math import prod
from multiprocessing.shared_memory import SharedMemory
from shutil import disk_usage
from threading import Lock
from typing import TypeVar

import numpy as np

from maglev_lanes.processes import fresh_pool

Item, Result = TypeVar("Item"), TypeVar("Result")
_MEMORY = "/dev/shm"  # of Linux, where shared memory is a file system of limited size


@dataclass(frozen=True)
class Place:
    """Where an array of doubles lies: in which shared memory, from which byte on, and its shape."""

    memory: str
    start: int
    shape: tuple[int, ...]

    def array(self) -> np.ndarray:
        """The array, in another process than the one that made it; valid until that one forgets it."""
        return np.ndarray(self.shape, float, _attached(self.memory).buf, self.start)


@cache
def _attached(name: str) -> SharedMemory:
    return SharedMemory(name)


class SharedPool:
    """Processes, and arrays that they can read.

    Args:
        pool: the processes.
    """

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool, self._lock = pool, Lock()
        self._all: list[tuple[int, SharedMemory]] = []  # with the address of its first byte
        self._free: list[tuple[int, SharedMemory]] = []

    @property
    def memories(self) -> list[str]:
        """Names of all shared memory that was taken."""
        return [memory.name for _, memory in self._all]

    def empty(self, shape: tuple[int, ...]) -> np.ndarray:
        """As np.empty, where the processes can read it, if there is room."""
        size = max(1, 8 * prod(shape))
        with self._lock:
            fitting = [one for one in self._free if size <= one[1].size <= 2 * size]
            if fitting:
                self._free.remove(fitting[0])
                return np.ndarray(shape, float, fitting[0][1].buf)
            if size > _room():  # what is written beyond it would end this process
                return np.empty(shape)
            memory = SharedMemory(create=True, size=size)
            found = np.ndarray(shape, float, memory.buf)
            self._all.append((found.ctypes.data, memory))
            return found

    def place(self, array: np.ndarray) -> Place | None:
        """Where a part, without gaps, of an array that was made by `empty` lies; None: the processes cannot read it."""
        at = array.ctypes.data
        for first, memory in self._all:
            if first <= at < first + memory.size:
                return Place(memory.name, at - first, array.shape)
        return None

    def forget(self, names: set[str]) -> None:
        """Give the memory of arrays that nobody reads any more to the next ones, by the names in their places."""
        with self._lock:
            self._free += [one for one in self._all if one[1].name in names and one not in self._free]

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """function(item) of every item, in order."""
        return self._pool.map(function, items)

    def close(self) -> None:
        """Give all shared memory back."""
        for _, memory in self._all:
            memory.unlink()  # it is gone when the last array is; closing it here would fail while there is one


def _room() -> float:
    try:
        return disk_usage(_MEMORY).free
    except OSError:
        return float("inf")  # another system, where it is memory like any other


@contextmanager
def shared_pool(processes: int, first: Callable[[], object]) -> Iterator[SharedPool]:
    """A pool of new processes of one thread each, which end with the context.

    Args:
        processes: their number.
        first: what each of them does at first, such as importing what it needs, while this process goes on.
    """
    with fresh_pool(processes) as pool:
        shared = SharedPool(pool)
        for _ in range(processes):
            pool.submit(first)
        try:
            yield shared
        finally:
            shared.close()
