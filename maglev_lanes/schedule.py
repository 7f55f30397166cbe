"""Work on many machines: on the workers of a Dask scheduler, or of this machine, that `--scheduler` names.

A worker may die at any time; Dask then gives its work to another one. No data is stored on workers, because it would be
lost with them; every task carries all that it needs.

Dask runs any code that it receives. The processes of local:N therefore take it only from holders of a certificate that
lives in the memory of this process and its children, so that no other user of the machine can send them any.
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
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING, TypeVar

from maglev_lanes.code_version import code_version

if TYPE_CHECKING:
    from distributed import Client, Future

Item, Result = TypeVar("Item"), TypeVar("Result")

TIMEOUT = 10.0  # s, to reach a scheduler and its first worker
MOST_PROCESSES = 256  # of local:N
_AHEAD = 2  # tasks per worker at a time: one runs, one has arrived
# Packages of which another version could change the last digits, or the gains that are proposed.
_ALIKE = ("maglev-workbench", "numpy", "scipy", "numba", "optuna", "cmaes", "torch")
_SETTINGS = {
    # A campaign of recordings is sent as one task of some 13 MB; without this Dask would warn.
    "distributed.admin.large-graph-warning-threshold": "1GB",
    # Dask makes workers return freed memory at once; every new array then causes page faults, which halves the speed.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
    # After 15 s Dask would give up a process that it is starting again after a death, for ever: a busy machine needs
    # longer than that.
    "distributed.deploy.lost-worker-timeout": "10 minutes",
}
# Beside their encrypted ports, Dask's processes serve pages, which cannot be switched off, but can be left empty.
_NO_PAGES = {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}
_ADDRESS = re.compile(r"(?:tcp|tls)://(\[[^\]\s]+\]|[^\s:/\[\]]+):(\d{1,5})")
_LOCAL = re.compile(r"local:([1-9]\d{0,3})")


class Workers:
    """Workers of one thread each behind a client; their results do not depend on their number."""

    def __init__(self, client: "Client", address: str) -> None:
        self._client, self._address, self._code = client, address, code_version(blind=True)

    def __len__(self) -> int:
        """Their present number, but at least 1, because a worker that died comes back or is replaced."""
        try:
            return max(1, len(self._client.nthreads()))
        except OSError as error:
            raise self._gone() from error

    def map(self, function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """function(item) for every item, in order; errors as in `each`."""
        return [result for _, result in sorted(self.each(function, items), key=lambda pair: pair[0])]

    def each(
        self,
        function: Callable[[Item], Result],
        items: Iterable[Item],
        died: Callable[[float], Result] | None = None,
    ) -> Iterator[tuple[int, Result]]:
        """Apply a function to items on the workers.

        Items are taken only as fast as workers can have them. An item whose workers die repeatedly is tried once more
        when nothing else runs, so that no other item can be the cause. What has not begun is dropped when the caller
        stops.

        Args:
            function: What to apply.
            items: The items.
            died: Gives the result, from the seconds spent, of an item whose workers still die.

        Returns:
            Pairs (index, function(item)) as they arrive.

        Raises:
            OSError: The scheduler is gone, or workers die and `died` is not given.
            ValueError: A worker has another version of the code.
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
            if self._client.status == "running":  # a closed client has already dropped them
                self._client.cancel(list(under_way))

    def _gone(self) -> OSError:
        return OSError(f"the scheduler at {self._address} is gone; run the same command again to go on")


def scheduler_of(address: str) -> tuple[tuple[str, int], int]:
    """What an address names: host and port of a scheduler, or else a number of processes of this machine, which is then
    above 0.

    Raises:
        ValueError: It is neither.
    """
    remote, local = _ADDRESS.fullmatch(address), _LOCAL.fullmatch(address)
    if not remote and not local:
        raise ValueError(
            f"--scheduler {address}: give tcp://host:8786, as dask scheduler prints it, or local:4 for 4 processes here"
        )
    if local and int(local[1]) > MOST_PROCESSES:
        raise ValueError(f"--scheduler {address}: up to {MOST_PROCESSES}; more processes than cores are no use")
    return (remote[1].strip("[]"), int(remote[2])) if remote else ("", 0), int(local[1]) if local else 0


@contextmanager
def workers(address: str | None, here: int | None = None) -> Iterator[Workers | None]:
    """The workers at an address while the context lasts; None without an address.

    Args:
        address: tcp://host:port (or tls://) of a Dask scheduler, or local:N for N processes of this machine, which end
            with the context.
        here: The number of threads or processes requested on this machine, which must then be None.

    Raises:
        ValueError: The address is not valid, Dask is not installed, or the workers have other versions or several
            threads each.
        OSError: No scheduler or no worker answers within TIMEOUT.
    """
    if address is None:
        yield None
        return
    remote, local = scheduler_of(address)
    if here is not None:
        raise ValueError("give either --scheduler or a number of threads or processes: the scheduler's workers count")
    try:
        import dask
        from distributed import Client

        if local:
            import cryptography  # noqa: F401  for the temporary certificate
    except ImportError as error:
        raise ValueError('--scheduler needs Dask: pip install "dask[distributed]" cryptography') from error
    with dask.config.set(_SETTINGS):
        if local:
            with _processes(local) as client:
                yield Workers(client, address)
            return
        _answers(address, *remote)
        with Client(address, timeout=TIMEOUT, set_as_default=False) as client:
            _check(client, address)
            yield Workers(client, address)


@contextmanager
def _processes(n: int) -> "Iterator[Client]":
    """A client of n processes of this machine, whose ports and files are closed to its other users."""
    import dask
    from distributed import Client, LocalCluster, Security

    # The folder is created for this user alone; the default one is shared by all users.
    with TemporaryDirectory(prefix="maglev-", ignore_cleanup_errors=True) as scratch, dask.config.set(_NO_PAGES):
        cluster = LocalCluster(
            n_workers=n, threads_per_worker=1, host="127.0.0.1", memory_limit=0, security=Security.temporary(),
            local_directory=scratch, dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False},
            silence_logs=logging.CRITICAL, preload=[__name__],
        )  # fmt: skip
        try:
            with Client(cluster) as client:
                yield client
        finally:
            with suppress(TimeoutError):  # on a busy machine; what is slow to end now ends with this process
                cluster.close()


def dask_setup(worker: object) -> None:
    """Called by Dask in each process of local:N, which leaves Ctrl-C to the process that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _there(code: str, function: Callable[[Item], Result], item: Item) -> Result:
    """Runs on a worker: function(item), if the code is the same; every task checks, as workers come and go."""
    if code_version(blind=True) != code:
        raise ValueError(_other("a worker", "maglev-workbench", code_version(blind=True), code))
    return function(item)


def _answers(address: str, host: str, port: int) -> None:
    """Check that a scheduler answers.

    A Dask client would try a closed port again and again, and wait for ever at a port where something else listens.

    Raises:
        OSError: No scheduler answers.
    """
    from distributed import Security, rpc

    async def ask() -> None:
        socket.create_connection((host, port), TIMEOUT).close()
        async with rpc(address, connection_args=Security().get_connection_args("client")) as scheduler:
            await scheduler.identity()

    try:
        asyncio.run(asyncio.wait_for(ask(), TIMEOUT))
    except Exception as error:  # an answer in another protocol can make Dask's reader raise anything
        why = str(error) or f"silent for {TIMEOUT:g} s"
        raise OSError(
            f"no Dask scheduler answers at {address} ({why}): start one with dask scheduler; an encrypted one needs "
            "tls:// and its certificate in Dask's settings"
        ) from error


def _check(client: "Client", address: str) -> None:
    """Check that every present worker has one thread and the versions of this machine."""
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
