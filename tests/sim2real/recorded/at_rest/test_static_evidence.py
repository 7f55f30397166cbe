"""What means and weight say of a suspended mass, against a force law written down here."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.rig.rig_file import rig_from_toml
from sim2real.recorded.at_rest.static_evidence import (
    Levels,
    Tolerances,
    drift_in_words,
    joined,
    levels_of,
    of_weight,
    static_estimate,
)
from sim2real.recorded.at_rest.weight_law import balancing, lacking_in_words

MASS, GRAVITY, GAP, AIR = 0.02, 9.80665, 6e-3, 2e-3
CONSTANT = 5e-5  # N m2/A2: pull = CONSTANT i^2 / x^2 with x = GAP + AIR - y
TURNS, AREA = 800.0, 4 * CONSTANT / (4e-7 * np.pi * 800.0**2)
RIG = rig_from_toml(
    f"""
schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
[parameters]
mass = {MASS}
gap = {GAP + AIR}
clearance = {GAP}
turns = {TURNS}
pole_area = {AREA}
""",
    "here",
)
BIAS = (GAP + AIR) * np.sqrt(MASS * GRAVITY / CONSTANT)
TRUTH = np.array([2 * MASS * GRAVITY / BIAS, -2 * MASS * GRAVITY / (GAP + AIR)])
CERTAIN = Tolerances(0.0, 0.0)
FALLS = GRAVITY / 100.0**2  # m per sample squared at 100 Hz


def _levels(y, change=0.0, thicker=0.0):
    """Exact levels of a magnet with another constant and another magnetic gap than the rig's."""
    current = (GAP + AIR + thicker - y) * np.sqrt(MASS * GRAVITY / (CONSTANT * (1 + change))) - BIAS
    tiny = np.full(y.size, 1e-6)
    return Levels(y, current, tiny, tiny, np.zeros(y.size, int))


def test_levels_tell_gain_and_stiffness_on_the_scale_of_the_weight():
    y = np.linspace(-1e-3, 1e-3, 12)
    found = static_estimate(RIG, _levels(y, 0.2, -5e-4), CERTAIN)
    gap = GAP + AIR - 5e-4
    bias = gap * np.sqrt(MASS * GRAVITY / (1.2 * CONSTANT))
    assert found.gain == pytest.approx(2 * MASS * GRAVITY / bias, rel=1e-5)
    assert found.stiffness == pytest.approx(-2 * MASS * GRAVITY / gap, rel=1e-5)


def test_one_level_tells_the_gain_alone():
    found = static_estimate(RIG, _levels(np.full(8, 1e-4), 0.2), CERTAIN)
    assert found.stiffness is None and found.gain == pytest.approx(2 * MASS * GRAVITY / (BIAS / np.sqrt(1.2)), rel=1e-4)


def test_intervals_cover_the_scatter_and_the_stated_offsets():
    rng, y, inside = np.random.default_rng(1), np.repeat(np.linspace(-1e-3, 1e-3, 6), 4), []
    exact = _levels(y)
    for _ in range(80):
        offsets = 5e-5 * rng.normal(), 5e-3 * rng.normal()
        noisy = Levels(
            y + 2e-5 * rng.normal(size=y.size) + offsets[0],
            exact.current + 3e-3 * rng.normal(size=y.size) + offsets[1],
            np.full(y.size, 2e-5),
            np.full(y.size, 3e-3),
            np.zeros(y.size, int),
        )
        found = static_estimate(RIG, noisy, Tolerances(5e-5, 5e-3))
        inside.append(abs(found.values - TRUTH) < 1.96 * np.sqrt(np.diag(found.covariance)))
    assert (np.mean(inside, axis=0) > 0.87).all()  # 0.95 less 3.3 standard deviations
    assert not np.all(inside)


def test_only_a_resting_mass_has_levels():
    t = np.arange(4000) / 100
    steps = 1e-3 * np.sign(np.sin(2 * np.pi * t / 20))
    rest = levels_of(steps, 0.1 * steps, RIG, FALLS)
    assert rest.count > 30 and abs(abs(rest.displacement) - 1e-3).max() < 2e-5
    assert levels_of(1e-3 * np.sin(2 * np.pi * t), t, RIG, FALLS).count == 0
    assert levels_of(8e-5 * np.sin(2 * np.pi * 0.9 * t), t, RIG, FALLS).count == 40, "it carries its weight in the mean"
    # The same at 10 kHz is a swing at 90 Hz, whose acceleration takes part of the pull in each block of 10 ms.
    assert levels_of(8e-5 * np.sin(2 * np.pi * 0.9 * t), t, RIG, FALLS / 1e4).count < 8


def _carried(y, rate):
    """Current below the magnet that moves the mass along y (samples,), spectrally differentiated, A from the bias."""
    turn = (2j * np.pi * np.fft.rfftfreq(y.size, 1 / rate)) ** 2
    acceleration = np.fft.irfft(turn * np.fft.rfft(y), y.size)
    return (GAP + AIR - y) * np.sqrt(MASS * (GRAVITY + acceleration) / CONSTANT) - BIAS


@pytest.mark.parametrize("seed", [0, 2])
def test_a_mass_that_shakes_about_its_levels_carries_its_weight_there(seed):
    """A multisine up to 30 Hz whose blocks look at rest: their plain means accelerate and lie along a bent pull."""
    rng, rate = np.random.default_rng(seed), 2000.0
    t = np.arange(20000) / rate
    own = []
    for level in (0.0, 0.0, 1.5e-3):
        tones = zip(np.arange(1, 60), rng.uniform(0, 2 * np.pi, 59), strict=True)
        y = level + sum(1e-4 / (1 + (n / 20) ** 2) * np.cos(np.pi * n * t + phase) for n, phase in tones)
        own.append(levels_of(y, _carried(y, rate) + 1e-3 * rng.normal(size=t.size), RIG, GRAVITY / rate**2))
    found = static_estimate(RIG, joined(own), Tolerances(2e-5, 6e-3))
    sd = np.sqrt(np.diag(found.covariance))
    assert (abs(found.values / TRUTH - 1) < 0.06).all(), found
    assert (abs(found.values - TRUTH) < 3 * sd).all(), found


@pytest.mark.parametrize("mean", [-0.3, 0.0, 0.2])
@pytest.mark.parametrize(("size", "swing"), [(1e-6, 1e-4), (2e-3, 0.3)])
def test_the_nominal_magnet_carries_the_weight_over_the_recorded_motion_whatever_the_mean_current(mean, size, swing):
    turn = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    y, i = 1e-4 + size * np.sin(turn), swing * np.cos(turn + 1.0)
    total = BIAS + mean + i + balancing(RIG, (mean + i)[None], y[None])
    pull = CONSTANT * total**2 / (GAP + AIR - y) ** 2
    assert pull.mean() == pytest.approx(MASS * GRAVITY, rel=1e-6)


def test_a_mean_that_does_not_carry_the_weight_is_said():
    rest = np.zeros((1, 8))
    said = lacking_in_words(RIG, "command", balancing(RIG, rest - 0.08 * BIAS, rest))
    assert f"the mean command is {0.08 * BIAS:.3g} A (8% of the bias) below what" in said
    said = lacking_in_words(RIG, "current", balancing(RIG, rest + 0.08 * BIAS, rest))
    assert "above what" in said
    assert lacking_in_words(RIG, "command", balancing(RIG, rest + 0.04 * BIAS, rest)) is None


def test_gain_and_stiffness_grow_with_the_weight():
    # k_i = 2 m g / I with I in proportion to the root of m, and k = 2 m g / x.
    assert of_weight(RIG) == pytest.approx((0.5, 1.0), abs=1e-5)


def _drifting(rng, recordings, drift, levels=3):
    """Levels of recordings whose currents are off by an offset each; 1 mA and 10 µm of noise."""
    own = []
    for _ in range(recordings):
        y = np.repeat(rng.uniform(-1e-3, 1e-3, levels), 6)
        exact, n = _levels(y), y.size
        current = exact.current + 1e-3 * rng.normal(size=n) + drift * rng.normal()
        sd = np.full(n, 1e-5), np.full(n, 1e-3)
        own.append(Levels(y + 1e-5 * rng.normal(size=n), current, *sd, np.zeros(n, int)))
    return joined(own)


def test_recordings_that_rest_at_other_currents_have_an_offset_each():
    """Two of them at one level each would tilt the line; with an offset each, the levels within recordings tell it."""
    low, high = np.repeat([-1e-3, 1e-3], 8), np.repeat([-1e-3, -0.9e-3], 8)
    noise = iter(np.random.default_rng(2).normal(scale=2e-4, size=(2, 16)))
    own = []
    for y, offset in ((low, 0.0), (high, 0.03)):
        exact = _levels(y)
        own.append(replace(exact, current=exact.current + offset + next(noise)))
    stated = Tolerances(1e-5, 5e-3)
    found = static_estimate(RIG, joined(own), stated)
    plain = static_estimate(RIG, replace(joined(own), recording=np.zeros(32, int)), stated)
    assert 0.01 < found.drift < 0.04 and "from recording to recording" in drift_in_words(found)
    assert abs(found.values[1] / TRUTH[1] - 1) < 0.04 < 0.08 < abs(plain.values[1] / TRUTH[1] - 1)
    assert (abs(found.values - TRUTH) < 1.96 * np.sqrt(np.diag(found.covariance))).all()
    assert plain.drift == 0 and drift_in_words(plain) == ""


@pytest.mark.slow
@pytest.mark.parametrize(("drift", "recordings"), [(0.0, 4), (0.02, 2)])
def test_intervals_cover_with_offsets_of_recordings(drift, recordings):
    rng, inside, seen = np.random.default_rng(4), [], 0
    for _ in range(20):
        found = static_estimate(RIG, _drifting(rng, recordings, drift), Tolerances(1e-5, 2e-3))
        inside.append(abs(found.values - TRUTH) < 1.96 * np.sqrt(np.diag(found.covariance)))
        seen += found.drift > 0
    assert (np.mean(inside, axis=0) > 0.8).all()  # of 20: 0.95 less 3 standard deviations
    assert seen <= 1 if not drift else seen >= 17
