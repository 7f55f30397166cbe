"""The key of a kernel in the disk cache: what it reaches, and nothing else."""

import gc
import os
import subprocess
import sys

import pytest
from numba.core import event

from maglev_lanes.compiled import _way_of_compiling, compiled, fingerprint

SCALE = 2.0


def scaled(a):
    """Not what it says that counts."""
    return SCALE * a


def made(factor):
    def kernel(a):
        return factor * scaled(a)

    return kernel


def own(function, monkeypatch):
    monkeypatch.setattr("maglev_lanes.compiled.OWN", (__name__, "maglev_lanes"))
    return fingerprint(function)


def test_it_changes_with_constants_of_the_factory_and_of_the_functions_that_are_reached(monkeypatch):
    before = own(made(3.0), monkeypatch)
    assert own(made(3.0), monkeypatch) == before
    assert own(made(4.0), monkeypatch) != before
    monkeypatch.setitem(globals(), "SCALE", 5.0)
    assert own(made(3.0), monkeypatch) != before


def test_it_changes_with_how_pieces_are_compiled(monkeypatch):
    before = own(made(3.0), monkeypatch)
    monkeypatch.setattr("maglev_lanes.compiled.INLINED", {"forceinline": True})
    _way_of_compiling.cache_clear()
    other = own(made(3.0), monkeypatch)
    monkeypatch.undo()
    _way_of_compiling.cache_clear()
    assert other != before and own(made(3.0), monkeypatch) == before


def test_it_does_not_change_with_what_is_said_of_a_function(monkeypatch):
    before = own(made(3.0), monkeypatch)

    def scaled(a):
        """Other words."""
        return SCALE * a

    scaled.__qualname__ = "scaled"
    monkeypatch.setitem(globals(), "scaled", scaled)
    assert own(made(3.0), monkeypatch) == before


def adder(number):
    sources = 0

    def add(a):
        if sources == 0:
            return a
        return a + number

    return compiled(add)


class Watch(event.Listener):
    """Whether the garbage collector was on in each pass of the compiler."""

    def __init__(self):
        self.seen = set()

    def on_start(self, event):
        self.seen.add(gc.isenabled())

    def on_end(self, event):
        pass


@pytest.mark.parametrize("collected", [True, False])
def test_no_garbage_is_collected_while_the_compiler_runs_and_then_as_before(monkeypatch, tmp_path, collected):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    kernel = adder(3.0)
    if not collected:
        gc.disable()
    try:
        with event.install_listener("numba:run_pass", watch := Watch()):
            assert kernel(1.0) == 4.0
        assert gc.isenabled() == collected
    finally:
        gc.enable()
    assert watch.seen == {False}


IN_A_PROCESS = """
import numpy as np
from numba.core.registry import cpu_target
from maglev_lanes.line_spectra import LineSpectra
from maglev_lanes.layout import LANES

series = np.random.default_rng(1).standard_normal((40, 1, LANES))
print(LineSpectra(40, np.array([3]))(series, 0).sum(), len(cpu_target.typing_context._functions) > 0)
"""


def test_a_kernel_that_was_kept_is_loaded_without_declaring_what_the_compiler_knows(tmp_path):
    command, own = [sys.executable, "-c", IN_A_PROCESS], os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    made, loaded = (subprocess.run(command, env=own, capture_output=True, text=True, check=True) for _ in range(2))
    (value, declared), (again, declared_too) = made.stdout.split(), loaded.stdout.split()
    assert value == again and (declared, declared_too) == ("True", "False")
