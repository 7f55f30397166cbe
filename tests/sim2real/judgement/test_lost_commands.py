"""The scatter of lost commands, against commands that are lost one by one."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimation.lines.line_windows import KEPT, line_windows
from sim2real.judgement.lost_commands import louder_along, scatter_ratio, scatter_variance

RATE, SAMPLES = 1000.0, 20_000


def passed_on(command, lost, rng):
    """What the amplifier gets: each sample by its own draw."""
    passed = np.empty_like(command)
    last = command[0]
    for k, u in enumerate(command):
        if rng.random() >= lost:
            last = u
        passed[k] = last
    return passed


@pytest.mark.parametrize("lost", [0.1, 0.4])
def test_the_scatter_is_that_of_commands_that_are_lost_one_by_one(lost):
    rng = np.random.default_rng(5)
    time = np.arange(SAMPLES) / RATE
    command = 0.3 * np.sin(2 * np.pi * 3 * time) + 0.1 * rng.standard_normal(SAMPLES)
    windows = line_windows(SAMPLES, RATE, (20.0, 400.0))
    expected = np.mean([passed_on(command, lost, rng) for _ in range(60)], axis=0)
    drawn = [windows.spectrum(passed_on(command, lost, rng) - expected) for _ in range(20)]
    measured = np.mean(abs(np.array(drawn)) ** 2)
    frequency = windows.frequency.ravel()
    record = SimpleNamespace(windows=windows, first=0, command=command[None], frequency=frequency)
    opened = SimpleNamespace(plant=np.ones((1, frequency.size)), outputs=("plant",))
    part = SimpleNamespace(opened=opened, noise=np.ones((1, 1, frequency.size)))
    predicted = float(np.mean(scatter_ratio(part, record, lost)))
    assert measured / (1 + 1 / 60) == pytest.approx(predicted, rel=0.05)  # the mean of 60 draws has its own variance


def test_a_command_that_stands_still_does_not_scatter():
    assert scatter_variance(np.full((2, 100), 0.7), 0.3) == pytest.approx([0.0, 0.0])


def test_along_a_chirp_the_scatter_is_that_of_its_moment():
    """A chirp that dwells at low frequencies: their windows hold the calm part of the record along the excitation, and
    all of it in the other directions."""
    rng, lost, samples = np.random.default_rng(6), 0.4, 4000
    time = np.arange(samples) / RATE
    turns = 20.0 * time[-1] / np.log(10.0) * np.expm1(time / time[-1] * np.log(10.0))  # 20 .. 200 Hz
    command = np.sin(2 * np.pi * turns)
    windows = line_windows(samples, RATE, (30.0, 180.0))
    drives = windows.spectrum(command[None])
    expected = np.mean([passed_on(command, lost, rng) for _ in range(60)], axis=0)
    drawn = np.stack([passed_on(command, lost, rng) - expected for _ in range(60)])
    measured = windows.noise(windows.spectrum(drawn), drives)
    ratio = (measured.explained / measured.rank).mean(axis=0) / measured.variance.mean(axis=0)
    frequency = np.repeat(windows.centre, KEPT)
    record = SimpleNamespace(windows=windows, first=0, command=command[None], frequency=frequency, drives=drives)
    opened = SimpleNamespace(plant=np.ones((1, frequency.size)), outputs=("plant",))
    part = SimpleNamespace(opened=opened, noise=np.full((1, 1, frequency.size), 1e-9))
    (found,) = louder_along(part, record, lost)
    low, high = windows.centre < 80, windows.centre > 130
    assert found[low].mean() < 0.7 and found[high].mean() > 1.4
    assert ratio[low].mean() == pytest.approx(found[low].mean(), rel=0.15)
    assert ratio[high].mean() == pytest.approx(found[high].mean(), rel=0.15)
    part.noise = np.full((1, 1, frequency.size), 1e9)  # of which the scatter is nothing
    assert louder_along(part, record, lost) == pytest.approx(np.ones((1, windows.count)))
