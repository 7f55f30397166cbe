"""The gain over frequency of a record with a period, on spectra drawn for the test."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from drawn_spectra import draw, record, two_channels

from estimation.actuator import actuator_estimate, as_force
from estimation.apparent_gain import TOLD, edges, periodic_gain, tells

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


@pytest.mark.parametrize("periods", [2, 3])
def test_intervals_cover_where_few_periods_tell_the_noise(periods):
    """Bands of three lines tell their noise with six freedoms over two periods; twelve bands must hold together."""
    known = replace(actuator_estimate(spectra(GAIN), MASS), gain=GAIN, stiffness=K, stiffness_se=0.0, damping=0.0,
                    damping_se=0.0, cost_ratio=1.0)  # fmt: skip
    draws, records = draw(replace(spectra(GAIN, noise=1.0), periods=periods), 400, seed=7), 400
    inside, together = [], []
    for i in range(records):
        found = periodic_gain(as_force(record(draws, i), "current", GAIN), MASS, known)
        ends = [(b.size[1:], b.phase[1:]) for b in found.bands]
        inside += [(low <= GAIN <= high, early <= 0 <= late) for (low, high), (early, late) in ends]
        level = found.together
        sizes, phases = [[getattr(b, f"{name}_within")(level)[1:] for b in found.bands] for name in ("size", "phase")]
        together.append(
            [all(low <= GAIN <= high for low, high in sizes), all(low <= 0 <= high for low, high in phases)]
        )
    assert (np.mean(inside, axis=0) > 0.935).all()
    assert (np.mean(together, axis=0) > 0.93).all()


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


def found_of(draws, records, mass=MASS):
    for i in range(records):
        one = actuator_estimate(record(draws, i), mass)
        found = periodic_gain(as_force(record(draws, i), "current", one.gain), mass, one)
        if found:
            yield found


def levitated(gain, lag=0.0, of_y=5e-5, periods=4):
    """A rotor of 1 kg at 200 lines, most of which move it little; (displacement, current)."""
    f = np.arange(1.0, 201.0)
    w = 2 * np.pi * f
    current = 0.5 * np.exp(0.2j * f**1.5)
    moved = gain / (1 + 1j * w * lag) * current / (-3e4 - w**2)
    noise = np.diag([of_y**2, 1e-6]) / periods
    return replace(two_channels(f, current, moved, noise, periods), channels=("displacement", "current"))


def test_one_gain_for_all_frequencies_is_rarely_told_to_change():
    found = list(found_of(draw(levitated(10.0), 60, seed=41), 60, 1.0))
    assert np.mean([one.latest is not None for one in found]) < 0.13
    assert np.mean([one.extremes is not None for one in found]) < 0.13
    known = actuator_estimate(levitated(10.0, of_y=1e-9), 1.0)
    lagging = record(draw(levitated(10.0, lag=2e-3, of_y=1e-6), 1, seed=42), 0)
    late = periodic_gain(as_force(lagging, "current", 10.0), 1.0, known)
    largest, smallest = late.extremes
    assert largest.frequency < smallest.frequency and late.latest.phase_within(late.together)[2] < 0


def test_bands_that_tell_a_gain_in_much_noise_tell_the_right_one():
    """Were the noisy gain itself the measure of its noise, those that chance made large would be told."""
    size, inside = [], []
    for found in found_of(draw(levitated(10.0), 80, seed=43), 80, 1.0):
        for b in found.bands:
            if b.f_lo > 100:
                size.append(abs(b.gain))
                inside.append((b.size[1] <= 10 <= b.size[2], b.phase[1] <= 0 <= b.phase[2]))
    assert len(size) > 30 and np.median(size) < 15 and (np.mean(inside, axis=0) > 0.82).all()


def test_a_current_in_the_opposite_direction_is_not_half_a_turn_late():
    (same,), (turned,) = (found_of(draw(levitated(g, 1e-3, 1e-8), 1, seed=44), 1, 1.0) for g in (10.0, -10.0))
    for b, other in zip(same.bands, turned.bands, strict=True):
        assert other.phase == pytest.approx(b.phase, abs=0.5) and other.size == pytest.approx(b.size, abs=0.5)
        assert other.gain.real < 0 < b.gain.real
        assert b.phase[0] == pytest.approx(-np.degrees(np.arctan(2e-3 * np.pi * b.frequency)), abs=1)
    assert turned.latest.f_lo == same.latest.f_lo


@pytest.mark.parametrize("resonance", [False, True])
def test_an_unsure_stiffness_and_damping_are_in_the_errors(resonance):
    """As large as the gain moves if they are wrong by their standard errors, also in the flank of a resonance."""
    if resonance:
        dynamic, mass = 5e4 - W**2 + 20j * W, 1.0
        current = np.exp(0.2j * F**1.5)
        exact = replace(spectra(GAIN), mean=np.array([GAIN * current / dynamic, current]))
    else:
        exact, mass = spectra(GAIN), MASS
    sure = replace(actuator_estimate(exact, mass), stiffness_se=1e-9, damping_se=1e-9, cost_ratio=1.0)

    def gains(one):
        return periodic_gain(as_force(exact, "current", one.gain), mass, one).bands

    of_k, of_c = 1e-4 * abs(sure.stiffness), (1e-3 * sure.damping if resonance else 0.0)
    moved_k = gains(replace(sure, stiffness=sure.stiffness + of_k))
    moved_c = gains(replace(sure, damping=sure.damping + of_c))
    told = gains(replace(sure, stiffness_se=of_k, damping_se=of_c, cost_ratio=4.0))  # one gain fits half as well
    for plain, by_k, by_c, b in zip(gains(sure), moved_k, moved_c, told, strict=True):
        off = np.array([by_k.gain - plain.gain, by_c.gain - plain.gain]) / plain.gain
        assert b.size_se == pytest.approx(2 * np.hypot(*off.real) * abs(plain.gain), rel=0.05)
        assert b.phase_se == pytest.approx(2 * np.hypot(*off.imag), rel=0.05, abs=1e-4)


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


def test_the_scatter_is_what_the_gains_of_bands_differ_beyond_their_errors():
    of_one = [found.scatter for found in found_of(draw(spectra(GAIN, noise=1.0), 60, seed=45), 60)]
    assert np.median(of_one) == 0.0
    uneven = spectra(GAIN * (1 + 0.02 * np.sin(4 * np.log(F))), noise=0.1)
    of_many = [found.scatter for found in found_of(draw(uneven, 20, seed=46), 20)]
    assert np.mean(of_many) == pytest.approx(0.02 / 2**0.5, rel=0.4)
    # Of equal errors it is what the variance of the bands has beyond theirs, relative to their mean.
    some = next(iter(found_of(draw(spectra(GAIN, noise=1.0), 1, seed=45), 1)))
    gains, se = np.array([1.0, 1.3, 0.8, 1.1, 1.4]), 0.1
    bands = tuple(replace(some.bands[0], gain=complex(g), own_se=se) for g in gains)
    assert replace(some, bands=bands).scatter == pytest.approx(np.sqrt(gains.var(ddof=1) - se**2) / gains.mean())


def test_a_small_gain_is_told_as_well_as_its_size_and_a_large_one_as_well_as_the_common_one():
    none = np.zeros(1)
    for factor, size in ((0.4, 0.4), (3.0, 1.0)):
        for times, told in ((0.98, True), (1.02, False)):
            assert tells((times * TOLD * size) ** 2, factor, none) == told
