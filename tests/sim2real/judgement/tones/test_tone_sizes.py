"""The size of each tone that has a name: of all recordings, with its error, and of parts that were seen apart."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.judgement.tones.sightings import FOREIGN, Sighting
from sim2real.judgement.tones.tone_sizes import tone_parameters, tone_sizes, tones_in_words

MAINS, RECEPTANCE, SPEED = "pickup 50 Hz", 2e-5, 3000.0
PROBLEM = SimpleNamespace(
    parts=[SimpleNamespace(record=SimpleNamespace(experiment=SimpleNamespace(speed_rpm=SPEED)))] * 3
)


def tone(record, size, sd, harmonic=1, family=MAINS, frequency=50.03):
    return Sighting(record, family, harmonic, harmonic * frequency, size, sd, RECEPTANCE, (size / sd) ** 2)


def test_tones_of_the_mains_are_those_that_are_there():
    """A third harmonic without a second one is no series of falling ones."""
    found = [tone(0, 600e-9, 5e-9), tone(1, 590e-9, 8e-9), tone(0, 250e-9, 5e-9, 3), tone(1, 5e-9, 4e-9, 2)]
    first, third = tone_sizes(PROBLEM, found, "pickup")
    assert (first.harmonic, third.harmonic) == (1, 3) and third.frequency == pytest.approx(150.09)
    assert first.value == pytest.approx(595e-9, abs=3e-9) and 5e-9 < first.se < 20e-9
    assert tones_in_words("pickup", (first, third)) == "pickup 595 +- 13 nm at 50.03 Hz and 250.0 +- 9.0 nm at 150.1 Hz"
    assert tone_parameters(PROBLEM, found, "pickup")["frequency"] == 50.0


def test_recordings_that_disagree_widen_the_error_and_scatter_stays_within_it():
    sizes, rng = [], np.random.default_rng(1)
    for _ in range(300):
        (own,) = tone_sizes(PROBLEM, [tone(i, 6e-7 + 3e-8 * rng.standard_normal(), 3e-8) for i in range(3)], "pickup")
        sizes.append((own.value - 6e-7) / own.se)
    assert 0.7 < np.std(sizes) < 1.0  # a form of the amplitude is allowed for besides
    (apart,) = tone_sizes(PROBLEM, [tone(0, 4e-7, 1e-9), tone(1, 8e-7, 1e-9)], "pickup")
    assert apart.se > 1e-7


def test_parts_of_one_tone_on_a_line_and_beside_it_are_one_tone():
    found = [tone(0, 250e-9, 2e-9), tone(0, 377e-9, 5e-9)]
    (own,) = tone_sizes(PROBLEM, found, "pickup")
    assert own.value == pytest.approx(627e-9) and abs(own.value - 600e-9) < own.se  # of 600 nm


def test_a_force_is_the_size_through_the_receptance():
    found = [tone(i, 2e-7, 2e-9, family="spin", frequency=50.0) for i in range(2)]
    (unbalance,) = tone_sizes(PROBLEM, found, "unbalance")
    assert unbalance.value == pytest.approx(2e-7 / RECEPTANCE / (100 * np.pi) ** 2)
    shaken = [tone(0, 2e-7, 2e-9, family=FOREIGN, frequency=61.7), tone(1, 9e-9, 5e-9, family=FOREIGN, frequency=83.0)]
    (force,) = tone_sizes(PROBLEM, shaken, "foreign_vibration")
    assert force.value == pytest.approx(0.01) and force.frequency == pytest.approx(61.7)
    assert tone_parameters(PROBLEM, shaken, "foreign_vibration") == {
        "force": force.value,
        "phase": 0.0,
        "frequency": 61.7,
    }
    assert tone_sizes(PROBLEM, [], "pickup") == tone_sizes(PROBLEM, [], "foreign_vibration") == ()
