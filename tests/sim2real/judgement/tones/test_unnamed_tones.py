"""What lies between the lines of the drive and has no name, in words."""

from types import SimpleNamespace

import numpy as np

from sim2real.judgement.tones.between_lines import between_lines
from sim2real.judgement.tones.sightings import FOREIGN, LOUD, Sighting


def problem(fundamental=1.0, periods=4, count=2):
    e = SimpleNamespace(fundamental=fundamental, recorded_per_period=1000)
    record = SimpleNamespace(experiment=e, series={"displacement": np.zeros((1, 1000 * periods))})
    return SimpleNamespace(parts=[SimpleNamespace(record=record)] * count)


def seen(family, *at, record=0):
    return [Sighting(record, family, 1, f, 1e-7, 1e-8, 1e-5, 500.0 - f) for f in at]


def test_lines_that_something_periodic_shifts_are_told_from_tones():
    """A stiffness that changes at 37.3 Hz answers beside each line."""
    shifted = seen(FOREIGN, 3.703, 4.297, 7.71, 46.30) + seen(FOREIGN, 3.70, 12.298, record=1)
    found = between_lines(problem(), shifted)
    assert found.shift[0] == 1.0 and abs(found.shift[1] - 0.3) < 0.01
    assert found.tones == (3.70, 4.297, 7.71, 12.298, 46.30)  # each once
    said = found.in_words()
    assert said.startswith("tones at 3.7, 4.297, 7.71, 12.3 Hz and 1 more; all tones are 0.29")
    assert between_lines(problem(), shifted + seen(FOREIGN, 61.55)).shift is None  # a fan beside
    assert between_lines(problem(), shifted[:3]).shift is None  # too few


def test_tones_anywhere_have_no_distance_in_common():
    rng, alarms = np.random.default_rng(1), 0
    for _ in range(500):
        tones = seen(FOREIGN, *rng.uniform(5, 200, 5))
        alarms += between_lines(problem(), tones).shift is not None
    assert alarms < 5


def test_bands_and_single_tones_are_said_and_nothing_is_none():
    found = between_lines(problem(), seen(FOREIGN, 61.7) + seen(LOUD, 120.0, 130.0))
    assert found.in_words() == "tones at 61.7 Hz and noise around 120 Hz"
    assert between_lines(problem(), seen("spin", 50.0)) is None
