"""What the whole suite shares when it runs on several processes (`pytest -n 2`).

Most of its time goes into compiling kernels, so no two processes compile the same one, and the files that take longest
go first, so that no process is left alone with one of them at the end.
"""

import gc
import os
import sys
from collections import Counter
from functools import cache
from hashlib import sha256
from pathlib import Path
from tempfile import gettempdir

import pytest
from typer import testing

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the commands do; read when numpy is imported

# pytest puts this folder on the path. Its subfolders have the names of the packages, and would hide those of an
# editable installation.
sys.path = [entry for entry in sys.path if Path(entry or ".").resolve() != Path(__file__).parent]


def pytest_configure(config: pytest.Config) -> None:
    # A runner would build the options of all commands for each call anew: three quarters of what a refused call takes.
    testing._get_command = cache(testing._get_command)
    worker = getattr(config, "workerinput", None)
    if worker is not None:
        _read_from_both_ends(config, worker["workerid"])
        _compile_once(Path(gettempdir()) / f"maglev-tests-{worker['testrunuid']}")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if hasattr(config, "workerinput"):
        slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
        items.sort(key=lambda item: (-slow[item.path], item.path))  # within a file the order stays


def pytest_collection_finish() -> None:
    """Keep what is imported and collected out of every later collection of garbage: it stays until the end anyway."""
    gc.collect()
    gc.freeze()


def _read_from_both_ends(config: pytest.Config, worker: str) -> None:
    """Let every second process collect the folders of tests from the last one to the first.

    A process rewrites the assertions of a file that it imports, and keeps the result for all. Those that start together
    and go the same way would all rewrite every file.
    """
    folders = [path for arg in config.args for path in Path(arg).glob("*/") if any(path.rglob("test_*.py"))]
    if worker in {"gw1", "gw3"} and [Path(arg).resolve() for arg in config.args] == [Path(__file__).parent]:
        config.args = [str(path) for path in sorted(folders, reverse=True)]


def _compile_once(folder: Path) -> None:
    """Let numba's cache be shared by processes that start together.

    A process that wants a kernel which another is compiling waits and loads it. numba rewrites the index of a cache
    without a lock: of two kernels stored at the same time one would be lost, and compiled again.
    """
    from filelock import FileLock
    from numba.core.caching import Cache
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.dispatcher import Dispatcher

    folder.mkdir(exist_ok=True)
    compile_one, store = Dispatcher.compile, Cache.save_overload

    def compiled(self, sig):
        if not isinstance(self._cache, Cache):
            return compile_one(self, sig)
        function = self.py_func
        key = repr((function.__module__, function.__qualname__, self._cache._index_key(sig, self.targetctx.codegen())))
        # The lock of this process first: threads that compile would else wait for one another in a circle.
        with global_compiler_lock, FileLock(folder / sha256(key.encode()).hexdigest()):
            return compile_one(self, sig)

    def stored(self, sig, data):
        with FileLock(folder / "store"):
            store(self, sig, data)

    Dispatcher.compile, Cache.save_overload = compiled, stored
