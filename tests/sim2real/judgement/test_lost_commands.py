"""The scatter of lost commands, against commands that are lost one by one."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimation.lines.line_windows import KEPT, POOLED, line_windows
from sim2real.judgement.lost_commands import (
    louder_along,
    scatter_cost,
    scatter_cost_of,
    scatter_ratio,
    scatter_variance,
)
from sim2real.recorded.open_record import OpenRecord
from sim2real.search.fit import Fit
from sim2real.search.hypotheses import Hypothesis

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


LOSSY = Hypothesis(("dropped_samples",), {})


@pytest.fixture
def part(monkeypatch):
    """A record of white commands, whose noise is just what is made of them when three in ten are lost."""
    command = np.random.default_rng(7).standard_normal((1, 20_000))
    windows = line_windows(20_000, RATE, (20.0, 400.0))
    record, frequency = object.__new__(OpenRecord), np.repeat(windows.centre, KEPT)
    for key, value in {"windows": windows, "first": 0, "every": 1, "upstream": ()}.items():
        object.__setattr__(record, key, value)
    monkeypatch.setattr(OpenRecord, "command", command, raising=False)
    monkeypatch.setattr(OpenRecord, "frequency", frequency, raising=False)
    ones = np.ones((1, frequency.size))
    opened = SimpleNamespace(plant=ones, outputs=("plant",))
    part = SimpleNamespace(
        opened=opened, noise=ones[None], record=record, place=slice(None), measured=ones[None], used=ones[0] > 0
    )
    part.noise = np.sqrt(scatter_ratio(part, record, 0.3))[None]
    return part


def residual_of(rng, part, variance=1.0):
    return (rng.standard_normal((part.used.size, 2)) @ np.array([1.0, 1.0j])) * np.sqrt(variance)


@pytest.mark.parametrize(
    ("noise", "left", "sign"),
    [
        (0.3, 1.0, 1),  # the noise was told from what is left, and commands that are lost would leave more
        (0.3, 9.0, -1),  # more is left than the noise that other recordings allow: as much as they make
        (9.0, 1.0, 0),  # the noise is larger than what they make
    ],
)
def test_what_lost_commands_leave_is_weighed_by_the_scatter_that_they_make(part, noise, left, sign):
    part.noise = noise * part.noise
    problem, residual = SimpleNamespace(parts=(part,)), residual_of(np.random.default_rng(8), part, left)
    cost = scatter_cost_of(problem, 0.3, residual)
    assert np.sign(cost) == sign and (sign == 0 or abs(cost) > 1000)
    assert scatter_cost_of(problem, 0.0, residual) == 0.0
    part.opened.plant = np.array(part.opened.plant)
    part.opened.plant[:, KEPT : 2 * KEPT] = 100.0  # it rings in one window, which tells nothing
    assert scatter_cost_of(problem, 0.3, residual) == pytest.approx(cost, rel=0.05)


def test_noise_that_is_told_from_a_few_windows_is_not_too_small_for_lost_commands(part):
    rng, made, found = np.random.default_rng(9), part.noise, []
    for _ in range(20):
        own = rng.chisquare(2 * KEPT, part.used.size // KEPT + POOLED - 1) / (2 * KEPT)
        told = np.repeat(np.convolve(own, np.ones(POOLED) / POOLED, "valid"), KEPT)
        part.noise = made * np.sqrt(told)
        found.append(scatter_cost_of(SimpleNamespace(parts=(part,)), 0.3, residual_of(rng, part, 1 / told)))
    assert part.used.size > 5000 and np.mean(found) < 6.0


@pytest.mark.parametrize(("told_to", "asked"), [(0.1, True), (0.001, False)])
def test_how_many_are_lost_the_scatter_tells_together_with_the_fit(part, told_to, asked):
    """Two in five would scatter a third more than there is."""
    (own,), size = LOSSY.coordinates, part.used.size
    residual = residual_of(np.random.default_rng(8), part)
    jacobian = np.full((1, size), own.scale / told_to / np.sqrt(size), complex)
    fit = Fit(LOSSY, np.array([own.at(0.4)]), residual, 0.0, jacobian)
    problem = SimpleNamespace(parts=(part,))
    assert fit.spread[0] * own.scale == pytest.approx(told_to)
    alone, together = scatter_cost_of(problem, 0.4, residual), scatter_cost(problem, fit)
    assert alone > 50 and (together < 5 if asked else together > 0.8 * alone)
    fit.jacobian = np.zeros((1, size), complex)  # beside a lag, which may be any part of what is late
    assert scatter_cost(problem, fit) < 5
    fit.jacobian = None
    assert scatter_cost(problem, fit) == alone
    assert scatter_cost(problem, Fit(Hypothesis((), {}), np.zeros(0), residual, 0.0)) == 0.0
