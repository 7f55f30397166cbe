"""What changes from period to period, on sums of sines that are evaluated at the times of each device."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.redundancy.changes import clocks, copies, ranges_changed
from maglev_env.redundancy.view import View
from maglev_env.rig.excitation import Excitation

RATE, SAMPLES, PERIODS = 10e3, 5000, 6
LINES = tuple(range(3, 120, 4))
FUNDAMENTAL = RATE / SAMPLES


def channel(rng, ppm=0.0, noise=0.05):
    """A channel (samples,) with lines of its own, read by a clock that runs faster by some ppm."""
    t = np.arange(PERIODS * SAMPLES) * (1 + 1e-6 * ppm) / RATE
    lines = zip(LINES, rng.uniform(0.2, 1.0, len(LINES)), 2 * np.pi * rng.random(len(LINES)), strict=True)
    x = sum(a * np.cos(2 * np.pi * n * FUNDAMENTAL * t + p) for n, a, p in lines)
    return x + noise * x.std() * rng.normal(size=t.size)


def view(**channels):
    excitation = Excitation("sphs", "force", FUNDAMENTAL, LINES, 1.0)
    names = frozenset(channels)
    return View("run", RATE, channels, names, {n: n for n in names}, (excitation,), frozenset(), None, (), None, 1.0)


def test_sound_periods_have_one_clock_one_range_and_noise():
    rng = np.random.default_rng(1)
    for _ in range(20):
        seen = view(force=channel(rng, noise=0.01), displacement=channel(rng, noise=float(rng.choice([0.02, 0.5]))))
        assert [f for rule in (clocks, ranges_changed, copies) for f in rule(seen)] == []


@pytest.mark.parametrize("ppm", [30.0, -100.0])
def test_a_channel_of_another_clock_is_named_with_its_rate(ppm):
    rng = np.random.default_rng(2)
    rest = {"force": channel(rng), "displacement": channel(rng)}
    (found,) = clocks(view(**rest, current=channel(rng, ppm)))
    assert found.channel == "current" and found.interval[0] < abs(ppm) < found.interval[1]
    (found,) = clocks(view(force=rest["force"], displacement=channel(rng, ppm)))
    assert found.channel == "displacement or force" and "ppm" in found.message


def test_a_gain_that_drifts_in_the_loop_is_no_clock():
    """It turns the phases of the lines near the bandwidth, and changes their sizes as much."""
    rng, drive = np.random.default_rng(11), channel(np.random.default_rng(5), noise=0.0)
    spectrum, f = np.fft.rfft(drive), np.fft.rfftfreq(drive.size, 1 / RATE)
    s = 2j * np.pi * f
    closed = [np.fft.irfft(spectrum * gain / (s**2 / 800**2 + s / 1500 + gain), drive.size) for gain in (1.0, 0.9)]
    share = np.linspace(0.0, 1.0, drive.size)
    moved = (1 - share) * closed[0] + share * closed[1]
    seen = view(force=drive, displacement=moved + 1e-3 * moved.std() * rng.normal(size=drive.size))
    assert clocks(seen) == []


def test_a_period_that_is_left_out_leaves_the_rate_of_a_clock_as_it_is():
    rng = np.random.default_rng(9)
    seen = view(force=channel(rng), displacement=channel(rng), current=channel(rng, 100.0))
    (found,) = clocks(replace(seen, left_out=frozenset({2})))
    assert found.interval[0] < 100.0 < found.interval[1] and found.value == pytest.approx(100.0, rel=0.05)


@pytest.mark.parametrize("ppm", [200.0, -900.0])
def test_a_recorder_whose_clock_is_not_that_of_the_excitation_is_named(ppm):
    rng = np.random.default_rng(7)
    (found,) = clocks(view(force=channel(rng, -ppm), displacement=channel(rng, -ppm)))
    assert found.channel == "all channels" and found.value == pytest.approx(ppm, rel=1e-2)
    assert ("fast" if ppm > 0 else "slow") in found.message and "true rate is" in found.message


@pytest.mark.parametrize("factor", [10.0, 0.5])
@pytest.mark.parametrize("share", [0.5, 0.62])
def test_a_change_of_range_is_named_with_its_factor_and_time(factor, share):
    rng = np.random.default_rng(3)
    x = channel(rng, noise=0.3)
    x[int(share * x.size) :] *= factor
    (found,) = ranges_changed(view(force=channel(rng), displacement=x))
    assert found.channel == "displacement" and found.value == pytest.approx(factor, rel=0.1)
    assert "from the period at 1.5 s on" in found.message


def test_another_excitation_from_some_period_on_is_no_range():
    rng = np.random.default_rng(4)
    gain = np.where(np.arange(PERIODS * SAMPLES) < 4 * SAMPLES, 1.0, 3.0)
    (found,) = ranges_changed(view(force=channel(rng) * gain, displacement=channel(rng) * gain))
    assert found.channel == "all channels" and "the excitation changed" in found.message


def test_a_transient_and_a_shock_are_no_range():
    rng = np.random.default_rng(5)
    t = np.arange(PERIODS * SAMPLES) / RATE
    ringing = channel(rng) + 20 * np.exp(-t / 0.3) * np.sin(2 * np.pi * 31 * t)
    shocked = channel(rng) + 50 * np.exp(-(((t - 2.7) / 0.01) ** 2))
    assert ranges_changed(view(force=channel(rng), displacement=ringing)) == []
    assert ranges_changed(view(force=channel(rng), displacement=shocked)) == []


def test_periods_without_noise_of_their_own_are_copies():
    rng = np.random.default_rng(6)
    x = np.tile(channel(rng)[:SAMPLES], PERIODS)
    (found,) = copies(view(force=channel(rng), displacement=x))
    assert found.kind == "quality" and "intervals are too narrow" in found.message


@pytest.mark.parametrize(("left_out", "first"), [((), 2), ((0,), 2), ((3,), 2)])
def test_the_first_steady_period_is_counted_from_the_start_whatever_is_left_out(left_out, first):
    """A transient in the first two periods, of which one may be left out as well."""
    x = channel(np.random.default_rng(9), noise=0.01)
    x[: 2 * SAMPLES] += 3 * x.std() * np.exp(-np.arange(2 * SAMPLES) / SAMPLES)
    assert replace(view(displacement=x, force=x), left_out=left_out).lines.first == first
