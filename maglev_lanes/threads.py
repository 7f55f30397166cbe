"""Work that releases the interpreter lock, spread over cores; results are in order and the same for any number."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

from threadpoolctl import ThreadpoolController

Item, Result = TypeVar("Item"), TypeVar("Result")


def cores() -> int:
    """Number of cores that this process may use, as a container or `taskset` leaves them."""
    allowed = getattr(os, "sched_getaffinity", None)  # not on macOS and Windows
    return len(allowed(0)) if allowed else os.cpu_count() or 1


def over_threads(work: Callable[[Item], Result], items: Sequence[Item], threads: int | None) -> Iterator[Result]:
    """work(item) for every item, in order. An interrupt drops what has not begun.

    Meanwhile linear algebra uses one thread: on matrices as small as these its own threads mostly wait for each other
    and cost ten times what they gain.

    Args:
        work: What to do.
        items: The items.
        threads: Number of threads; None for all cores.
    """
    threads = min(threads or cores(), len(items))
    with single_blas():
        if threads <= 1:
            yield from map(work, items)
            return
        with ThreadPoolExecutor(threads) as pool:
            try:
                yield from pool.map(work, items)
            except BaseException:
                pool.shutdown(wait=True, cancel_futures=True)
                raise


def one_ahead(items: Iterator[Item]) -> Iterator[Item]:
    """The items of an iterator, each of which is made while the caller works on the one before."""
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(next, items, None)
        while (item := coming.result()) is not None:
            coming = pool.submit(next, items, None)
            yield item


@contextmanager
def single_blas() -> Iterator[None]:
    """Limits linear algebra to one thread while the context lasts."""
    with _blas().limit(limits=1, user_api="blas"):
        yield


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
