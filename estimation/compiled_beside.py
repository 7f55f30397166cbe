"""The likelihood compiled by a second process while this one compiles the simulation, where neither is on disk yet.

A compiler holds a lock of its process, so that two threads of one process would compile one after the other.
"""

import os
import subprocess
import sys
from functools import cache
from multiprocessing import parent_process
from pathlib import Path

import numpy as np

_NO = subprocess.DEVNULL
_MODULE = "band_likelihood"
LONGEST = 60.0  # s that are waited for the other process before this one compiles itself
_COMMAND = f"from {__name__} import compile_likelihood; compile_likelihood()"


_child: subprocess.Popen | None = None


def begin() -> None:
    """Start the second process where it helps: nothing is compiled yet, there is a second core, and this is no worker
    process, of which each would start one."""
    global _child
    alone = len(os.sched_getaffinity(0)) < 2 if hasattr(os, "sched_getaffinity") else os.cpu_count() == 1
    if _child is not None or alone or not sys.executable or parent_process() is not None or _on_disk():
        return
    here = os.environ | {"PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path)}
    try:
        _child = subprocess.Popen([sys.executable, "-P", "-c", _COMMAND], env=here, stdin=_NO, stdout=_NO, stderr=_NO)
    except OSError:  # this process compiles
        return


def wait() -> None:
    """Wait for the second process, if one was started. What it did not compile is compiled where it is used."""
    if _child is not None and _child.returncode is None:
        try:
            _child.wait(LONGEST)
        except subprocess.TimeoutExpired:
            _child.kill()
            _child.wait()


def compile_likelihood() -> None:
    """Run both compiled functions of the likelihood on two lines, which leaves them on disk."""
    from estimation.band_likelihood import bounds, estimate

    amplitude, real = np.array([[1.0 + 0.1j, 0.9 - 0.1j]]), np.full((1, 2), 1e-4)
    lines = np.array([10.0, 20.0]), np.array([1.0]), np.array([[0, 2]])
    found = estimate(amplitude, amplitude, real, real, 0j * real, *lines, 4)
    bounds(amplitude, amplitude, *lines, found, np.ones((1, 1, 2)))


@cache
def _on_disk() -> bool:
    """Whether some version of the likelihood is on disk. Where that is an older one, this process compiles."""
    from estimation.band_likelihood import estimator

    folder = getattr(getattr(estimator(), "stats", None), "cache_path", None)  # None where nothing is compiled
    return folder is None or any(Path(folder).glob(f"{_MODULE}.*.nbi"))
