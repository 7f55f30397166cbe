"""Threads over the cores that a process may use."""

import os
import subprocess
import sys

import pytest

from maglev_lanes.threads import cores


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="a process cannot be bound to cores here")
def test_a_process_that_may_use_one_core_has_one():
    one = min(os.sched_getaffinity(0))
    script = f"import os; os.sched_setaffinity(0, {{{one}}}); from maglev_lanes.threads import cores; print(cores())"
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert int(found.stdout) == 1 <= cores()
