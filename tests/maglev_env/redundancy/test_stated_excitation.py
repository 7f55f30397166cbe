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
        rig=None,
    )
    (row,) = designed(view)
    assert (row.misfit > row.most_misfit) == uneven


@pytest.mark.parametrize("every", [1, 2, 4])
def test_the_peak_is_that_of_the_samples_of_the_controller_and_not_of_every_fourth_of_them(every):
    """Of a waveform that was read at a quarter of its rate 96 % of the peak had been left, to be corrected."""
    rng = np.random.default_rng(9)
    lines, rate, samples = np.arange(1, 60), 4000.0, 1600
    time = 2 * np.pi * np.arange(samples) / samples
    wave = sum(np.cos(k * time + rng.uniform(0, 2 * np.pi)) for k in lines)
    peak = float(np.abs(wave).max())
    wave = np.roll(wave, 1 - int(np.abs(wave).argmax()))  # the peak lies between those that are read
    read = wave[::every]
    e = Excitation("multisine", "current", rate / samples, tuple(lines.tolist()), peak)
    parts = {"injection": np.repeat(period_spectra(read[None], lines), 3, axis=0)}
    view = SimpleNamespace(
        excitations=(e,),
        stated_peaks={"current"},
        recorded={"injection"},
        lines=Lines(lines * rate / samples, parts, True, lines, 0),
        block=(samples // every, 1),
        channels={"injection": np.tile(read, 3)},
        rate=rate / every,
        rig=SimpleNamespace(control_rate=rate),
    )
    (row,) = designed(view)
    assert row.gain == pytest.approx(1.0, abs=1e-6) and not row.off
    assert every == 1 or np.abs(read).max() < 0.999 * peak
