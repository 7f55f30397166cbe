"""The scatter of lost commands, against commands that are lost one by one."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimation.lines.line_windows import KEPT, line_windows
from sim2real.compared.simulated import Point
from sim2real.judgement.lost_commands import louder_along, scatter_cost, scatter_ratio, scatter_variance
from sim2real.recorded.open_record import OpenRecord

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


@pytest.mark.parametrize(
    ("noise", "left", "sign"),
    [
        (1.0, 1.0, 1),  # the noise was told from what is left, and commands that are lost would leave more
        (1.0, 9.0, -1),  # more is left than the noise that other recordings allow: as much as they make
        (30.0, 1.0, 0),  # the noise is larger than what they make
    ],
)
def test_what_lost_commands_leave_is_weighed_by_the_scatter_that_they_make(monkeypatch, noise, left, sign):
    rng, lost = np.random.default_rng(7), 0.3
    command = rng.standard_normal((1, 4000))
    windows = line_windows(4000, RATE, (20.0, 400.0))
    frequency = np.repeat(windows.centre, KEPT)
    record = object.__new__(OpenRecord)
    fields = {"windows": windows, "first": 0, "every": 1, "upstream": (), "source": None}
    for key, value in fields.items():
        object.__setattr__(record, key, value)
    monkeypatch.setattr(OpenRecord, "command", command, raising=False)
    monkeypatch.setattr(OpenRecord, "frequency", frequency, raising=False)
    plant = np.ones((1, frequency.size))
    opened = SimpleNamespace(plant=plant, outputs=("plant",))
    part = SimpleNamespace(opened=opened, noise=plant[None], record=record, place=slice(None), measured=plant[None])
    part.used = np.ones(frequency.size, bool)
    part.noise = part.noise * noise * np.sqrt(scatter_ratio(part, record, lost).mean()) / 3
    both = rng.standard_normal((2, frequency.size)) * np.sqrt(left)
    problem, point = SimpleNamespace(parts=(part,)), Point({"dropped_samples": {"probability": lost}}, {})
    cost = scatter_cost(problem, point, both[0] + 1j * both[1])
    assert np.sign(cost) == sign and (sign == 0 or abs(cost) > 100)
    assert scatter_cost(problem, Point({}, {}), both[0] + 1j * both[1]) == 0.0
    plant[:, KEPT : 2 * KEPT] = 100.0  # it rings in one window, which tells nothing
    assert scatter_cost(problem, point, both[0] + 1j * both[1]) == pytest.approx(cost, rel=0.25, abs=1e-9)
