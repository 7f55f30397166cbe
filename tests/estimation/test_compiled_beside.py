"""What the second process compiles is what the estimator then asks for."""

import os
import subprocess
import sys

import pytest

from estimation import compiled_beside

ESTIMATED = """
from estimation import compiled_beside
compiled_beside.begin()
compiled_beside.wait()
assert compiled_beside._child.returncode == 0
import numpy as np
from estimation import band_likelihood
from estimation.lines.periods import line_statistics
from estimation.max_likelihood import maximum_likelihood
rng = np.random.default_rng(1)
spectra = 1 + 0.1 * (rng.normal(size=(4, 2, 2, 2)) @ np.array([1, 1j]))  # periods of two channels at two lines
statistics = line_statistics(spectra, 10.0, np.array([1, 2]), ("force", "displacement"))
maximum_likelihood(statistics, np.array([[5.0, 25.0]]), 1.0)
for kernel in (band_likelihood.estimator(), band_likelihood.bounds_finder()):
    assert sum(kernel.stats.cache_hits.values()) == 1 and not kernel.stats.cache_misses, kernel.stats
"""


@pytest.mark.slow
def test_what_the_second_process_compiles_is_what_the_estimator_uses(tmp_path):
    """A version for other types would leave the first process to compile its own as well."""
    here = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run([sys.executable, "-c", ESTIMATED], env=here, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_goes_on_where_the_second_process_fails_or_hangs(monkeypatch):
    """The estimator then compiles by itself; nothing waits for ever."""
    for command, longest in (("raise SystemExit(1)", 10.0), ("import time; time.sleep(60)", 0.1)):
        child = subprocess.Popen([sys.executable, "-c", command])
        monkeypatch.setattr(compiled_beside, "_child", child)
        monkeypatch.setattr(compiled_beside, "LONGEST", longest)
        compiled_beside.wait()
        assert child.returncode is not None
