"""Responses that recordings without a period show, against Welch's estimate and of a bench of another hand."""

from dataclasses import replace

import numpy as np
import pytest
from bench_loop import Bench, write_campaign
from scipy import signal

from estimation.lines.tones import Tone
from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.problem import assemble
from sim2real.open_curves import open_curves
from sim2real.recorded.records import read_records

SOFTER = Point({}, {"negative_stiffness": -0.05})


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    folder = write_campaign(tmp_path_factory.mktemp("softer"), Bench(stiffness=-0.05), {"noise": "fit"}, 4.0, 0)
    _, (record,) = read_records(folder)
    return assemble([record]).parts[0]


def test_the_sensitivity_is_that_of_welch(part):
    (curve,) = open_curves(part, NOMINAL, SOFTER)
    assert curve.kind == "sensitivity"
    rate = part.record.windows.sample_rate
    added, command = part.record.added[0], part.record.command[0]
    f, cross = signal.csd(added, command, rate, nperseg=4096)
    welch = cross / signal.welch(added, rate, nperseg=4096)[1]
    expected = np.interp(curve.frequency, f, welch)
    assert abs(curve.measured / expected - 1).max() < 0.1
    assert np.median(abs(curve.measured / expected - 1)) < 0.02


def test_the_true_rig_is_as_far_as_the_noise_and_another_is_farther(part):
    (curve,) = open_curves(part, NOMINAL, SOFTER)
    assert np.mean(curve.distance(curve.corrected) ** 2) == pytest.approx(1.0, abs=4 / np.sqrt(curve.frequency.size))
    low = curve.frequency < 100  # where the stiffness matters
    assert np.mean(curve.distance(curve.nominal)[low] ** 2) > 20


def test_what_a_rounded_command_leaves_is_no_excitation(part):
    dust = replace(part.record, added=1e-6 * part.record.added)
    assert open_curves(replace(part, record=dust), NOMINAL, SOFTER) == []


def test_a_window_with_a_tone_shows_no_response(part):
    (whole,) = open_curves(part, NOMINAL, SOFTER)
    tone = Tone(float(whole.frequency[3]) + 1.0, {"opened": np.array([1e-6 + 0j])}, 100.0)
    record = replace(part.record, tones=(tone,))
    (curve,) = open_curves(replace(part, record=record), NOMINAL, SOFTER)
    assert set(whole.frequency) - set(curve.frequency) == {whole.frequency[3]}
