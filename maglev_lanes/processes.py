"""Processes on this machine, for work that the interpreter lock would slow down in threads."""

import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from queue import SimpleQueue
from threading import Thread
from typing import TypeVar

Item, Result = TypeVar("Item"), TypeVar("Result")

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@contextmanager
def fresh_pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """New processes with one thread each; libraries read this from the environment when they are first imported."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"), initializer=_end_with_the_parent)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def beside_others(
    function: Callable[[Item], Result], items: Sequence[Item], processes: int, first: Callable[[], object]
) -> Iterator[tuple[int, Result]]:
    """function(item) of every item with its number, as they are finished, by this process and by new ones beside it.

    This process works while the others start, which takes a second or two. What has not begun when the caller stops is
    dropped.

    Args:
        function: what to do, on one thread.
        items: the items.
        processes: number of all processes.
        first: what each new one does at first, such as importing what it needs.

    Raises:
        BrokenExecutor: A process was ended from outside.
    """
    waiting, done = deque(enumerate(items)), SimpleQueue()

    def work(one: Callable[[Item], Result]) -> None:
        with suppress(IndexError):  # nothing is left
            while True:
                i, item = waiting.popleft()
                done.put((i, one(item)))

    def here() -> None:
        work(function)

    def there() -> None:
        pool.submit(first).result()
        work(lambda item: pool.submit(function, item).result())

    def told(of: Callable[[], None]) -> None:
        try:
            of()
        except BaseException as error:
            done.put((None, error))

    with fresh_pool(processes - 1) as pool, ThreadPoolExecutor(processes) as threads:
        try:
            for of in (here, *[there] * (processes - 1)):
                threads.submit(told, of)
            for _ in items:
                i, result = done.get()
                if i is None:
                    raise result
                yield i, result
        finally:
            waiting.clear()


def _end_with_the_parent() -> None:
    """End this process at Ctrl-C, not only after its current work, and when its parent is gone.

    A parent that is terminated or killed, or whose terminal is closed, cannot end its processes itself; they would wait
    for work for ever.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    parent = parent_process()
    if parent is not None:
        Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()
