"""Tones between the harmonics: found to their Cramer-Rao scatter, never in noise, and what they leave of a line."""

import numpy as np
import pytest
from scipy import signal

from estimation.lines.periods import line_statistics, period_spectra, split_periods
from estimation.lines.tones import MOST, beside_tone, remove_tones, stands_alone, tone_at

RATE, PER_PERIOD, PERIODS = 20e3, 2500, 8
TOTAL = PER_PERIOD * PERIODS
RESOLUTION = RATE / TOTAL
TIME = np.arange(TOTAL) / RATE


def sine(frequency, amplitude, phase=0.3):
    return amplitude * np.cos(2 * np.pi * frequency * TIME + phase)


def found_in(values, **others):
    channels = {"displacement": np.atleast_2d(values)} | {k: np.atleast_2d(v) for k, v in others.items()}
    return remove_tones(channels, PER_PERIOD, RATE)


def test_frequency_and_amplitude_scatter_as_cramer_and_rao_say():
    """Var f = 6 s^2 / (pi^2 a^2 N T^2), of a complex amplitude var = 4 s^2 / N, in white noise of sd s per sample; the
    period that is taken out takes its share of both."""
    rng, sd, amplitude, frequency = np.random.default_rng(1), 1.0, 0.2, 52.7
    off = []
    for _ in range(60):
        phase = rng.uniform(-3, 3)
        _, tones = found_in(sine(frequency, amplitude, phase) + sd * rng.standard_normal(TOTAL))
        tone = min(tones, key=lambda t: abs(t.frequency - frequency))
        own = abs(tone.amplitude["displacement"][0])
        bound = np.sqrt(6 * sd**2 / (np.pi**2 * amplitude**2 * TOTAL)) / TIME[-1]
        off.append([(tone.frequency - frequency) / bound, (own - amplitude) / np.sqrt(2 * sd**2 / TOTAL)])
    spread = np.std(off, axis=0, ddof=1)
    assert (spread > 0.75).all() and (spread < 1.4).all()
    assert abs(np.mean(off, axis=0)).max() < 4 * 1.3 / np.sqrt(60)


@pytest.mark.parametrize("apart", [0.9, 1.6, 2.4])
def test_two_tones_that_are_hardly_apart_are_told_apart(apart):
    """In bins of the record's resolution: 50 Hz mains beside a rotor at nearly 3,000 rpm."""
    rng, sizes, first = np.random.default_rng(7), (1.0, 0.6), 52.3 * RESOLUTION + 40
    frequencies = first, first + apart * RESOLUTION
    both = sum(sine(f, a, phase) for f, a, phase in zip(frequencies, sizes, (0.3, 2.0), strict=True))
    _, tones = found_in(both + 0.05 * rng.standard_normal(TOTAL))
    assert len(tones) == 2
    for f, a in zip(frequencies, sizes, strict=True):
        tone = min(tones, key=lambda t: abs(t.frequency - f))
        assert tone.frequency == pytest.approx(f, abs=0.03 * RESOLUTION)
        assert abs(tone.amplitude["displacement"][0]) == pytest.approx(a, rel=0.05)


def test_white_noise_shows_no_tone():
    rng = np.random.default_rng(2)
    for axes in (1, 2):
        for _ in range(60):
            values = rng.standard_normal((axes, TOTAL))
            cleaned, tones = found_in(values)
            assert tones == []
            np.testing.assert_array_equal(cleaned["displacement"], values)


def resonant(rng):
    """Noise through a mode at 61 Hz of 2.5 % damping, which is 3 bins of the record wide."""
    ringing = signal.tf2sos(*signal.iirpeak(61.0, 20.0, RATE))
    mode = signal.sosfilt(ringing, rng.standard_normal(2 * TOTAL))[TOTAL:]
    return 0.1 * rng.standard_normal(TOTAL) + 10 * mode


@pytest.mark.xfail(strict=True, reason="a resonance narrower than the neighbours of a tone stands out of them")
def test_noise_through_a_resonance_shows_no_tone():
    rng = np.random.default_rng(3)
    assert sum(bool(found_in(resonant(rng))[1]) for _ in range(5)) <= 1


def test_noise_through_a_resonance_leaves_more_around_it_than_a_tone_does():
    rng = np.random.default_rng(3)
    for _ in range(4):
        cleaned, tones = found_in(resonant(rng))
        alone = [stands_alone(cleaned["displacement"], tone, PER_PERIOD, RATE) for tone in tones]
        assert alone and not all(alone)
    for size in (0.15, 10.0):
        for axes in (1, 2):
            noise = rng.standard_normal((axes, TOTAL))
            cleaned, (tone,) = found_in(noise + sine(rng.uniform(65.0, 71.0), size))
            assert stands_alone(cleaned["displacement"], tone, PER_PERIOD, RATE)


def test_periodic_signals_show_no_tone():
    """What repeats with the period is the excitation's, however large; so is a tone of the mains on a line."""
    rng = np.random.default_rng(3)
    periodic = np.tile(1e3 * rng.standard_normal(PER_PERIOD), PERIODS) + rng.standard_normal(TOTAL)
    assert found_in(periodic)[1] == []
    assert RATE / PER_PERIOD == 8.0 and found_in(sine(120.0, 5.0) + rng.standard_normal(TOTAL))[1] == []


@pytest.mark.parametrize(("grows", "turns"), [(0.2, 0.0), (0.05, 0.1), (0.2, 0.2)])
def test_excited_lines_that_grow_or_turn_are_no_tones(grows, turns):
    """A gain that drifts adds to every excited line what looks like a tone within a bin of it."""
    rng, own, n = np.random.default_rng(3), RATE / PER_PERIOD, 5 * PER_PERIOD
    t, along = TIME[:n], TIME[:n] / TIME[n]
    phases = {k: 2 * np.pi * k * own * t + k for k in (1, 3, 5, 7, 9)}
    noise = 1e-3 * rng.normal(size=n)
    fading = sum(k / 9 * (1 + grows * along) * np.cos(p + turns * k / 9 * along) for k, p in phases.items()) + noise
    cleaned, tones = found_in(fading)
    assert tones == [] and np.allclose(cleaned["displacement"][0], fading, atol=1e-12)
    lines = sum(k / 9 * np.cos(p) for k, p in phases.items()) + noise
    mains = 9 * own - 0.4 * RATE / n
    _, (tone,) = found_in(lines + 0.02 * np.cos(2 * np.pi * mains * t))
    assert tone.frequency == pytest.approx(mains, abs=0.05 * RATE / n)


def test_several_tones_are_taken_out_of_all_channels():
    rng = np.random.default_rng(4)
    at = {50.0: 1.0, 67.5: 0.4, 777.3: 0.1}
    noise, other = rng.standard_normal((2, TOTAL))
    tones = sum(sine(f, a) for f, a in at.items())
    cleaned, found = found_in(tones + noise, current=3.0 * tones + other)
    assert [t.frequency for t in found] == pytest.approx(list(at), abs=0.02)
    for tone, (_, a) in zip(found, at.items(), strict=True):
        assert abs(tone.amplitude["displacement"][0]) == pytest.approx(a, abs=0.05)
        assert abs(tone.amplitude["current"][0]) == pytest.approx(3 * a, abs=0.06)
    # What is left differs from the noise by the freedoms fitted: four of 20,000, three times.
    for name, own in (("displacement", noise), ("current", other)):
        assert np.std(cleaned[name][0] - own) < 0.05
    assert found_in(cleaned["displacement"])[1] == []


def test_the_chi_square_of_a_tone_is_its_power_over_the_noise():
    rng = np.random.default_rng(8)
    sizes = [found_in(sine(53.0, 0.2) + rng.standard_normal(TOTAL))[1][0].chi2 for _ in range(30)]
    assert 0.7 * 0.2**2 * TOTAL / 2 < np.mean(sizes) < 0.2**2 * TOTAL / 2 + 4  # told by the loudest of three floors


@pytest.mark.parametrize("frequency", [53.0, 52.7])
def test_a_loud_tone_between_two_bins_does_not_hide_how_quiet_the_record_is(frequency):
    """Its leakage is 80 times the noise of the bins beside it."""
    noise = 0.01 * np.random.default_rng(9).standard_normal(TOTAL)
    (tone,) = found_in(sine(frequency, 1.0) + noise)[1]
    assert tone.chi2 == pytest.approx(TOTAL / 2 / 0.01**2, rel=0.4)


def test_two_axes_have_a_tone_in_common():
    rng = np.random.default_rng(5)
    values = rng.standard_normal((2, TOTAL)) + np.array([[0.03], [-0.2]]) * sine(1234.5, 1.0, 0.0)
    _, (tone,) = found_in(values)
    x, y = tone.amplitude["displacement"]
    assert y.real == pytest.approx(-0.2, abs=0.04) and abs(x - 0.03) < 0.04


def test_each_axis_is_compared_with_its_own_noise():
    """Beside an axis with a thousand times its noise, a tone is found as in the quiet one alone, and noise has none."""
    rng = np.random.default_rng(15)
    for _ in range(12):
        values = rng.standard_normal((2, TOTAL)) * np.array([[1.0], [1e-3]])
        assert found_in(values)[1] == []
        values[1] += 1e-3 * sine(52.7, 0.2, rng.uniform(-3, 3))
        _, (tone,) = found_in(values)
        (alone,) = found_in(values[1])[1]
        assert tone.frequency == pytest.approx(alone.frequency, abs=0.1 * RESOLUTION)
        assert tone.chi2 == pytest.approx(alone.chi2, rel=0.2)
        both, quiet = (tone_at(v, 52.7, PER_PERIOD, RATE)[1] for v in (values, values[1:]))
        assert both == pytest.approx(quiet, rel=0.2)
    silent = np.stack([values[1], 0 * values[1]])
    assert found_in(silent)[1][0].frequency == pytest.approx(alone.frequency, abs=1e-3 * RESOLUTION)


def test_no_more_tones_are_looked_for_than_records_have():
    rng = np.random.default_rng(6)
    many = sum(sine(f, 2.0) for f in 101.0 + 62.0 * np.arange(MOST + 3))
    assert len(found_in(many + rng.standard_normal(TOTAL))[1]) == MOST


def test_two_periods_are_too_few_to_tell():
    values = sine(51.0, 5.0)[None, : 2 * PER_PERIOD]
    assert remove_tones({"displacement": values}, PER_PERIOD, RATE)[1] == []


def test_a_tone_too_small_to_be_found_is_measured_where_it_is_known_to_be():
    """Its amplitude scatters as in white noise, and without it the chi-square has two degrees per axis."""
    rng, sd, frequency = np.random.default_rng(21), 1.0, 47.3
    amplitude = 3 * sd / np.sqrt(TOTAL)
    for size, axes in ((amplitude, 1), (0.0, 1), (0.0, 2)):
        chi2, own = [], []
        for _ in range(80):
            values = sine(frequency, size, rng.uniform(-3, 3)) + sd * rng.standard_normal((axes, TOTAL))
            found, power = tone_at(values, frequency, PER_PERIOD, RATE)
            chi2.append(power)
            own.append(np.linalg.norm(found))
        expected = 2 * axes + size**2 * TOTAL / (2 * sd**2)
        assert np.mean(chi2) == pytest.approx(expected, rel=0.25)
        assert np.mean(np.square(own)) == pytest.approx(size**2 + 4 * axes * sd**2 / TOTAL, rel=0.3)


@pytest.mark.parametrize("off", [0.04, 0.08, 0.3])
def test_what_a_tone_leaves_uncertain_of_the_line_beside_it_is_what_scatters(off):
    """Periods of a tone that lies between two lines, with its frequency unknown; truth and noise are drawn here."""
    rng, lines, at = np.random.default_rng(9), np.arange(4, 13), 8
    clean = sine(8.0 * 6, 0.3) + sine(8.0 * at, 0.5, 1.0)
    errors, claimed, scatter = [], [], []
    for _ in range(60):
        values = clean + sine(8.0 * (at + off), 3.0, rng.uniform(-3, 3)) + rng.standard_normal(TOTAL)
        cleaned, (tone,) = found_in(values)
        periods = [period_spectra(p, lines) for p in split_periods(cleaned["displacement"], PER_PERIOD)]
        s = line_statistics(periods, 8.0, lines, ("displacement",))
        wide = beside_tone(s, tone, tone.amplitude["displacement"], [0], PER_PERIOD / RATE)
        errors.append(s.mean[0] - period_spectra(clean[None, :PER_PERIOD], lines)[0])
        claimed.append(wide.cross("displacement", "displacement"))
        scatter.append(s.cross("displacement", "displacement"))
    real, here = np.mean(np.abs(errors) ** 2, axis=0), lines == at
    assert np.median(claimed, axis=0)[here] == pytest.approx(real[here], rel=0.6)
    assert np.mean(scatter, axis=0)[~here] == pytest.approx(real[~here], rel=0.4)  # the lines around are as without it
    np.testing.assert_array_equal(np.array(claimed)[:, ~here], np.array(scatter)[:, ~here])
    if off == 0.04:
        assert (real > 5 * np.mean(scatter, axis=0))[here].all()  # which the periods do not show


@pytest.mark.parametrize("off", [0.03, 0.15])
def test_periods_of_several_excitation_periods_tell_a_tone_from_a_line_as_their_length_does(off):
    """A period of the excitation that is no whole number of samples: four of them are, and a tone turns four times as
    far; one that is nearer to a line of the four than to one of the excitation leaves that as it is."""
    rng, every, lines, at = np.random.default_rng(10), 4, np.arange(1, 6), 3
    fundamental = every * RATE / PER_PERIOD
    clean = sine(fundamental * 2, 0.3) + sine(fundamental * at, 0.5, 1.0)
    errors, claimed = [], []
    for _ in range(40):
        values = clean + sine(fundamental * (at + off), 3.0, rng.uniform(-3, 3)) + rng.standard_normal(TOTAL)
        cleaned, (tone,) = found_in(values)
        periods = [period_spectra(p, lines * every) for p in split_periods(cleaned["displacement"], PER_PERIOD)]
        s = line_statistics(periods, fundamental, lines, ("displacement",))
        wide = beside_tone(s, tone, tone.amplitude["displacement"], [0], PER_PERIOD / RATE)
        errors.append((s.mean[0] - period_spectra(clean[None, :PER_PERIOD], lines * every)[0])[at - 1])
        claimed.append(wide.cross("displacement", "displacement")[at - 1])
        assert (off > 0.125) == np.array_equal(wide.covariance, s.covariance)
    assert np.median(claimed) == pytest.approx(np.mean(np.abs(errors) ** 2), rel=0.5)
