"""A stated excitation against the recorded one."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimation.lines.periods import period_spectra
from maglev_env.redundancy.design import designed
from maglev_env.redundancy.view import Lines
from maglev_env.rig.excitation import Excitation

N, ODD = 400, tuple(range(1, 40, 2))
PHASE = 2 * np.pi * (np.arange(N) + 0.5) / N


FILTERED = sum(np.sin(k * PHASE + k**2) / k for k in ODD)
TWO = np.sin(PHASE) + 0.3 * np.sin(3 * PHASE)


@pytest.mark.parametrize(
    ("wave", "lines", "uneven"), [(FILTERED, ODD, True), (np.sign(np.sin(PHASE)), ODD, False), (TWO, (1, 3), False)]
)
def test_the_lines_of_steps_and_a_few_sines_are_unequal_by_nature(wave, lines, uneven):
    e = Excitation("multisine", "reference", 5.0, lines, float(np.abs(wave).max()))
    parts = {"reference": np.repeat(period_spectra(wave[None], np.array(lines)), 3, axis=0)}
    found = Lines(np.array(lines) * 5.0, parts, True, np.array(lines), 0)
    view = SimpleNamespace(
        excitations=(e,),
        stated_peaks={"reference"},
        recorded={"reference"},
        lines=found,
        block=(N, 1),
        channels={"reference": np.tile(wave, 3)},
    )
    (row,) = designed(view)
    assert (row.misfit > row.most_misfit) == uneven
