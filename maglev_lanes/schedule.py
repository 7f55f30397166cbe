"""Work on many machines: the workers of a Dask scheduler, or of this machine, that `--scheduler` names.

A worker may die at any moment: Dask gives its work to another one. Nothing is scattered, for what lies only on a worker
dies with it; every task carries all that it needs.
"""

import asyncio
import logging
import re
import signal
import socket
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from itertools import islice
from time import perf_counter
from typing import TYPE_CHECKING, TypeVar

from maglev_lanes.code_version import code_version

if TYPE_CHECKING:
    from distributed import Client, Future

Item, Result = TypeVar("Item"), TypeVar("Result")

TIMEOUT = 10.0  # s, to reach a scheduler and its first worker
_AHEAD = 2  # tasks under way per worker: one runs, one has arrived
# Other versions of these, other last digits, or other gains asked for.
_ALIKE = ("maglev-workbench", "numpy", "scipy", "numba", "optuna", "cmaes", "torch")
_SETTINGS = {
    # A campaign of recordings travels as one task of some 13 MB, of which Dask would warn.
    "distributed.admin.large-graph-warning-threshold": "1GB",
    # Dask lets workers hand freed memory back at once, and every array then costs its page faults: half the speed.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
}
_ADDRESS = re.compile(r"(?:tcp|tls)://(\[[^\]\s]+\]|[^\s:/\[\]]+):(\d{1,5})")
_LOCAL = re.compile(r"local:([1-9]\d{0,3})")


class Workers:
    """Workers of one thread each behind a client; what they return does not depend on how many there are."""

    def __init__(self, client: "Client", address: str) -> None:
        self._client, self._address, self._code = client, address, code_version()

    def __len__(self) -> int:
        """How many there are now, but at least 1: one that died comes back, or another one does."""
        try:
            return max(1, len(self._client.nthreads()))
        except OSError as error:
            raise self._gone() from error

    def map(self, function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """function(item) for every item, in their order. Errors as `each`."""
        return [result for _, result in sorted(self.each(function, items), key=lambda pair: pair[0])]

    def each(
        self,
        function: Callable[[Item], Result],
        items: Iterable[Item],
        died: Callable[[float], Result] | None = None,
    ) -> Iterator[tuple[int, Result]]:
        """(index, function(item)) as they are done; items are taken only as workers can have them.

        An item whose workers die again and again is tried once more when nothing else runs, so that no other can be to
        blame. If they still die, died(seconds) stands for its result; without it, OSError. OSError too when the
        scheduler goes away, ValueError from a worker of another version of the code, else whatever function raises.
        What has not begun is dropped when the caller stops.
        """
        lost: list[tuple[int, Item]] = []
        yield from self._each(function, enumerate(items), lambda i, item: lost.append((i, item)))
        for pair in lost:
            started, dead = perf_counter(), []
            yield from self._each(function, iter([pair]), lambda i, item, dead=dead: dead.append(i))
            if dead and died is None:
                raise OSError(f"{self._address}: part {pair[0] + 1} of the work ended every worker that it was given")
            if dead:
                yield pair[0], died(perf_counter() - started)

    def _each(
        self,
        function: Callable[[Item], Result],
        items: Iterator[tuple[int, Item]],
        lose: Callable[[int, Item], None],
    ) -> Iterator[tuple[int, Result]]:
        from distributed import CancelledError, KilledWorker, as_completed

        under_way: dict[Future, tuple[int, Item]] = {}
        done = as_completed(loop=self._client.loop)
        try:
            while True:
                for i, item in islice(items, max(0, _AHEAD * len(self) - len(under_way))):
                    future = self._client.submit(_there, self._code, function, item, pure=False)
                    under_way[future] = (i, item)
                    done.add(future)
                if not under_way:
                    return
                future = next(done)
                i, item = under_way.pop(future)
                try:
                    yield i, future.result()
                except KilledWorker:
                    lose(i, item)
                except CancelledError as error:
                    raise self._gone() from error
        finally:
            if self._client.status == "running":  # one that is closed has dropped them
                self._client.cancel(list(under_way))

    def _gone(self) -> OSError:
        return OSError(f"the scheduler at {self._address} is gone; run the same command again to go on")


@contextmanager
def workers(address: str | None, here: int | None = None) -> Iterator[Workers | None]:
    """The workers at an address while the context lasts; None without one.

    address: tcp://host:port (or tls://) of a Dask scheduler, or local:N for N processes of this machine, which end with
    the context. here: the threads or processes asked of this machine, which must then be None. ValueError when the
    address is not one, Dask is not installed, or the workers run other versions or several threads each; OSError when
    no scheduler or no worker answers within TIMEOUT.
    """
    if address is None:
        yield None
        return
    remote, local = _ADDRESS.fullmatch(address), _LOCAL.fullmatch(address)
    if not remote and not local:
        raise ValueError(
            f"--scheduler {address}: give tcp://host:8786, as dask scheduler prints it, or local:4 for 4 processes here"
        )
    if here is not None:
        raise ValueError("give either --scheduler or a number of threads or processes: the scheduler's workers count")
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise ValueError('--scheduler needs Dask: pip install "dask[distributed]"') from error
    with dask.config.set(_SETTINGS):
        if local:
            cluster = LocalCluster(
                n_workers=int(local[1]), threads_per_worker=1, host="127.0.0.1", memory_limit=0,
                dashboard_address="127.0.0.1:0", silence_logs=logging.CRITICAL, preload=[__name__],
            )  # fmt: skip
            try:
                with Client(cluster) as client:
                    yield Workers(client, address)
            finally:
                with suppress(TimeoutError):  # a busy machine; what is slow to end now ends with this process
                    cluster.close()
            return
        _answers(address, remote[1].strip("[]"), int(remote[2]))
        with Client(address, timeout=TIMEOUT, set_as_default=False) as client:
            _check(client, address)
            yield Workers(client, address)


def dask_setup(worker: object) -> None:
    """Called by Dask in each process of local:N, which leaves Ctrl-C to the one that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _there(code: str, function: Callable[[Item], Result], item: Item) -> Result:
    """On a worker: function(item), if the code is the same; workers come and go, so every task asks."""
    if code_version() != code:
        raise ValueError(_other("a worker", "maglev-workbench", code_version(), code))
    return function(item)


def _answers(address: str, host: str, port: int) -> None:
    """OSError unless a scheduler is there. A client would try a closed port again and again, and wait for ever on
    one where something else listens."""
    from distributed import Security, rpc

    async def ask() -> None:
        socket.create_connection((host, port), TIMEOUT).close()
        async with rpc(address, connection_args=Security().get_connection_args("client")) as scheduler:
            await scheduler.identity()

    try:
        asyncio.run(asyncio.wait_for(ask(), TIMEOUT))
    except Exception as error:  # what does not speak Dask's protocol can make its reader raise anything
        why = str(error) or f"silent for {TIMEOUT:g} s"
        raise OSError(f"no Dask scheduler answers at {address} ({why}): start one with dask scheduler") from error


def _check(client: "Client", address: str) -> None:
    """Every worker there now has one thread and the versions of this machine."""
    from distributed import TimeoutError as TimedOut

    try:
        client.wait_for_workers(1, TIMEOUT)
    except TimedOut:
        raise OSError(
            f"the scheduler at {address} has no workers; start some: dask worker {address} --nworkers 4 --nthreads 1"
        ) from None
    for worker, threads in client.nthreads().items():
        if threads != 1:
            raise ValueError(
                f"worker {worker} has {threads} threads; start workers with --nthreads 1, and more of them"
            )
    for name in _ALIKE:
        for worker, theirs in client.run(version, name, on_error="return").items():
            if theirs != version(name):
                raise ValueError(_other(f"worker {worker}", name, theirs, version(name)))


def _other(worker: str, name: str, theirs: object, mine: str) -> str:
    theirs = f"lacks {name}" if isinstance(theirs, Exception) else f"runs {name} {theirs}"
    return f"{worker} {theirs}, this machine {mine}: results could differ; install the same version on both"
