"""The gain over frequency of a record with a period, on spectra drawn for the test."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from drawn_spectra import draw, record, two_channels

from estimation.actuator import actuator_estimate, as_force
from estimation.apparent_gain import edges, periodic_gain

F = np.arange(2.0, 121.0, 2.0)
W = 2 * np.pi * F
MASS, GAIN, K = 0.08012, 5.7, -12.5e3


def spectra(gain, noise=0.0):
    """Current and displacement of a magnet whose gain (scalar or (n,)) may depend on frequency."""
    displacement = 2e-6 * np.exp(0.2j * F**1.5) / (1 + (F / 80) ** 2)
    current = (K - MASS * W**2) * displacement / gain
    root = noise * np.array([[1e-8, 0.0], [-60e-6, 40e-6]])
    return replace(two_channels(F, current, displacement, root @ root.T), channels=("displacement", "current"))


def test_a_lag_is_seen_as_it_is():
    """0.5 ms: the gain falls by 6 % and is 21 degrees late at 120 Hz; the fit of one gain calls it negative damping."""
    late = spectra(GAIN / (1 + 5e-4j * W))
    one = actuator_estimate(spectra(GAIN), MASS)
    found = periodic_gain(as_force(late, "current", one.gain), MASS, one)
    for b in found.bands:
        assert abs(b.gain * (1 + 5e-4j * 2 * np.pi * b.frequency) / GAIN - 1) < 0.002
    assert found.bands[-1].phase[0] < -15 and actuator_estimate(late, MASS).damping < 0


def test_intervals_cover():
    draws, records = draw(spectra(GAIN, noise=1.0), 200, seed=5), 200
    inside = []
    for i in range(records):
        one = actuator_estimate(record(draws, i), MASS)
        found = periodic_gain(as_force(record(draws, i), "current", one.gain), MASS, one)
        for b in found.bands:
            (_, low, high), (_, early, late) = b.size, b.phase
            inside.append((low <= GAIN <= high, early <= 0 <= late))
            assert b.size_se < 0.1 * GAIN
    covered = np.mean(inside, axis=0)
    assert (covered > 0.93).all()  # the stiffness of the same lines counts as independent, so they are wide


def test_noise_of_the_lines_is_in_the_errors_where_the_rest_is_known():
    known = replace(actuator_estimate(spectra(GAIN), MASS), gain=GAIN, stiffness=K, stiffness_se=0.0, damping=0.0,
                    damping_se=0.0, cost_ratio=1.0)  # fmt: skip
    draws, records = draw(spectra(2 * GAIN, noise=1.0), 200, seed=6), 200  # twice the gain that is taken for granted
    found = [periodic_gain(as_force(record(draws, i), "current", GAIN), MASS, known).bands for i in range(records)]
    assert len({len(bands) for bands in found}) == 1
    for same in zip(*found, strict=True):
        gains = np.array([b.gain for b in same])
        told = np.sqrt(np.mean([b.size_se**2 for b in same])), np.sqrt(np.mean([b.phase_se**2 for b in same]))
        assert told[0] == pytest.approx(np.abs(gains).std(), rel=0.35) and told[0] > 0.9 * np.abs(gains).std()
        assert told[1] == pytest.approx(np.angle(gains).std(), rel=0.35) and told[1] > 0.9 * np.angle(gains).std()


def test_a_tone_of_a_turning_rotor_does_not_look_like_another_gain():
    """It moves the rotor and, through the controller, the current at its line and those beside it."""
    expected, known = spectra(GAIN, noise=1.0), actuator_estimate(spectra(GAIN), MASS)
    beside = np.zeros(F.size)
    beside[39:42] = 0.05, 1.0, 0.05
    force = 20 * np.abs(expected.mean[0]).mean() * beside
    draws = draw(expected, 50, seed=8)
    covariance = np.array([1.0, 3000.0 - 900.0j])[:, None] * np.array([1.0, 3000.0 + 900.0j])
    spread = covariance[..., None] * force**2 / expected.periods
    for i in range(50):
        one = record(draws, i)
        turned = np.exp(2j * np.pi * i / 50) * force * np.array([1.0, 3000.0 - 900.0j])[:, None]
        toned = replace(one, mean=one.mean + turned, covariance=one.covariance + spread)
        for b in periodic_gain(as_force(toned, "current", known.gain), MASS, known).bands:
            (_, low, high), (_, early, late) = b.size, b.phase
            assert 0.98 * low < GAIN < 1.02 * high and early - 0.5 < 0 < late + 0.5
            assert b.size_se < 0.1 * GAIN


def test_an_unsure_stiffness_is_in_the_errors():
    sure = actuator_estimate(spectra(GAIN), MASS)
    unsure = replace(sure, stiffness_se=0.02 * abs(K), damping_se=0.0, cost_ratio=4.0)
    for b in periodic_gain(as_force(spectra(GAIN), "current", sure.gain), MASS, unsure).bands:
        inside = (b.f_lo <= F) & (b.f_hi > F)
        dynamic = np.mean(K - MASS * W[inside] ** 2)
        assert b.size_se == pytest.approx(GAIN * 2 * 0.02 * abs(K / dynamic), rel=1e-3)
        assert b.phase_se < 1e-4


@pytest.mark.parametrize("count", [58, 59, 60])
def test_bands_of_lines_adjoin_and_hold_three_lines(count):
    one, f = actuator_estimate(spectra(GAIN), MASS), F[:count]
    lines = as_force(spectra(GAIN).at_lines(spectra(GAIN).lines[:count]), "current", one.gain)
    bands = periodic_gain(lines, MASS, one).bands
    assert bands[0].f_lo == f[0] and bands[-1].f_lo <= f[-1] < bands[-1].f_hi
    for i, b in enumerate(bands):
        assert ((b.f_lo <= f) & (b.f_hi > f)).sum() >= 3
        assert i == 0 or bands[i - 1].f_hi == b.f_lo
        if b is not bands[-1]:  # the first line at which a band may end is its end
            assert b.f_hi >= b.f_lo * 2 ** (1 / 3)
            early = f[(b.f_lo * 2 ** (1 / 3) <= f) & (b.f_hi > f)]
            assert all(((b.f_lo <= f) & (end > f)).sum() < 3 for end in early)


def test_bands_adjoin_and_hold_what_they_must():
    found = edges(0.1, 100.0, 0.7)
    assert found[0] == (0.1, pytest.approx(0.8)) and found[-1][0] <= 100.0 < found[-1][1]
    assert all(a[1] == b[0] and b[1] - b[0] >= 0.7 - 1e-9 for a, b in pairwise(found))
