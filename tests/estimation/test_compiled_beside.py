"""What the second process compiles is what the estimator then asks for."""

import subprocess
import sys

import numpy as np
import pytest

from estimation import compiled_beside
from estimation.lines.periods import line_statistics
from estimation.max_likelihood import maximum_likelihood


@pytest.mark.slow
def test_compiles_the_versions_that_the_estimator_uses():
    """A version for other types would leave the first process to compile its own as well."""
    from estimation import band_likelihood

    compiled_beside.compile_likelihood()
    before = [list(f().signatures) for f in (band_likelihood.estimator, band_likelihood.bounds_finder)]
    rng = np.random.default_rng(1)
    spectra = 1 + 0.1 * (rng.normal(size=(4, 2, 2, 2)) @ np.array([1, 1j]))  # periods of two channels at two lines
    statistics = line_statistics(spectra, 10.0, np.array([1, 2]), ("force", "displacement"))
    maximum_likelihood(statistics, np.array([[5.0, 25.0]]), 1.0)
    assert [list(f().signatures) for f in (band_likelihood.estimator, band_likelihood.bounds_finder)] == before


def test_goes_on_where_the_second_process_fails_or_hangs(monkeypatch):
    """The estimator then compiles by itself; nothing waits for ever."""
    for command, longest in (("raise SystemExit(1)", 10.0), ("import time; time.sleep(60)", 0.1)):
        child = subprocess.Popen([sys.executable, "-c", command])
        monkeypatch.setattr(compiled_beside, "_child", child)
        monkeypatch.setattr(compiled_beside, "LONGEST", longest)
        compiled_beside.wait()
        assert child.returncode is not None
