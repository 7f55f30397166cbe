"""Tones between the harmonics: found to their Cramer-Rao scatter, told by origin, and never in noise."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import campaign
from scipy import signal

from estimation.lines.tones import MOST, remove_tones, tone_at
from maglev_env.loop.effect import effect
from sim2real.compared.problem import assemble
from sim2real.compared.simulated import Point, residuals, settling, together
from sim2real.judgement.sightings import Sighting, _higher_harmonics, _one_family
from sim2real.judgement.unsynchronised import evidence, spin_costs
from sim2real.recorded.records import read_records
from sim2real.recorded.tones import families, near_tones, origin, outstanding
from sim2real.search.hypotheses import TONES

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


@pytest.mark.xfail(strict=True, reason="a resonance narrower than the neighbours of a tone stands out of them")
def test_noise_through_a_resonance_shows_no_tone():
    """A mode at 61 Hz of 2.5 % damping is 3 bins of the record wide."""
    rng, ringing = np.random.default_rng(3), signal.tf2sos(*signal.iirpeak(61.0, 20.0, RATE))
    alarms = 0
    for _ in range(60):
        mode = signal.sosfilt(ringing, rng.standard_normal(2 * TOTAL))[TOTAL:]
        alarms += bool(found_in(0.1 * rng.standard_normal(TOTAL) + 10 * mode)[1])
    assert alarms <= 5


def test_periodic_signals_show_no_tone():
    """What repeats with the period is the excitation's, however large; so is a tone of the mains on a line."""
    rng = np.random.default_rng(3)
    periodic = np.tile(1e3 * rng.standard_normal(PER_PERIOD), PERIODS) + rng.standard_normal(TOTAL)
    assert found_in(periodic)[1] == []
    assert RATE / PER_PERIOD == 8.0 and found_in(sine(120.0, 5.0) + rng.standard_normal(TOTAL))[1] == []


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


def test_two_axes_have_a_tone_in_common():
    rng = np.random.default_rng(5)
    values = rng.standard_normal((2, TOTAL)) + np.array([[0.03], [-0.2]]) * sine(1234.5, 1.0, 0.0)
    _, (tone,) = found_in(values)
    x, y = tone.amplitude["displacement"]
    assert y.real == pytest.approx(-0.2, abs=0.04) and abs(x - 0.03) < 0.04


def test_no_more_tones_are_looked_for_than_records_have():
    rng = np.random.default_rng(6)
    many = sum(sine(f, 2.0) for f in 101.0 + 62.0 * np.arange(MOST + 3))
    assert len(found_in(many + rng.standard_normal(TOTAL))[1]) == MOST


def test_two_periods_are_too_few_to_tell():
    values = sine(51.0, 5.0)[None, : 2 * PER_PERIOD]
    assert remove_tones({"displacement": values}, PER_PERIOD, RATE)[1] == []


@pytest.mark.parametrize(
    ("frequency", "speed", "named"),
    [(50.0, 0.0, "pickup 50 Hz"), (150.02, 0.0, "pickup 50 Hz"), (120.3, 0.0, "pickup 60 Hz"), (53.0, 0.0, None),
     (53.0, 3180.0, "spin"), (159.0, 3180.0, "spin"), (212.0, 3180.0, None), (200.0, 0.0, None)],
)  # fmt: skip
def test_a_tone_is_told_by_its_frequency(frequency, speed, named):
    assert origin(frequency, speed, RESOLUTION) == named


def test_lines_near_known_tones_are_told():
    lines = 4.0 * np.arange(1, 60)
    assert set(lines[near_tones(lines, 0.4, 0.0)]) == {60.0, 100.0, 120.0, 180.0}
    assert set(lines[near_tones(lines, 0.4, 2640.0)]) == {44.0, 88.0, 132.0, 60.0, 100.0, 120.0, 180.0}
    assert {48.0, 52.0, 148.0} <= set(lines[near_tones(lines, 2.5, 0.0)])
    assert "spin" not in families(0.0) and families(3000.0)["spin"] == (50.0, 100.0, 150.0)


def test_a_line_stands_out_of_its_neighbours_or_not():
    rng = np.random.default_rng(7)

    def drawn(n, size=1.0):  # whitened residuals: |r|^2 is chi-square of two
        return size * (rng.standard_normal(n) + 1j * rng.standard_normal(n))

    alarms = sum(outstanding(drawn(1), drawn(24)) > 0 for _ in range(3000))
    assert alarms <= 6
    assert outstanding(np.array([8.0 + 0j]), drawn(24)) == pytest.approx(64.0, rel=0.6)
    assert outstanding(np.array([8.0 + 0j]), drawn(24, size=8.0)) == 0.0  # all is off there: no tone
    assert outstanding(np.array([6.0 + 0j]), []) == 36.0


def spin(record, speed, size, harmonic=1, receptance=1e-5):
    return Sighting(record, "spin", harmonic, speed / 60 * harmonic, size, 0.01 * size, receptance, 1e4)


class _Problem:
    """The speeds of a problem's recordings, which is all that sightings need."""

    def __init__(self, *speeds):
        experiment = [type("E", (), {"speed_rpm": s}) for s in speeds]
        record = [type("R", (), {"experiment": e}) for e in experiment]
        self.parts = [type("P", (), {"record": r}) for r in record]


def test_what_grows_with_the_square_of_the_speed_is_unbalance_and_what_stays_is_runout():
    problem = _Problem(3000.0, 6000.0)
    stays = spin_costs(problem, [spin(0, 3000.0, 1e-6), spin(1, 6000.0, 1e-6)])
    assert stays["runout"] < 1 and stays["unbalance"] > 50
    grows = spin_costs(problem, [spin(0, 3000.0, 1e-6), spin(1, 6000.0, 4e-6)])
    assert grows["unbalance"] < 1 and grows["runout"] > 50
    softer = spin_costs(problem, [spin(0, 3000.0, 1e-6), spin(1, 6000.0, 1e-6, receptance=2.5e-6)])
    assert softer["unbalance"] < 1  # four times the force on a quarter of the receptance
    harmonics = spin_costs(problem, [spin(0, 3000.0, 1e-6), spin(0, 3000.0, 3e-7, harmonic=2)])
    assert harmonics["unbalance"] == pytest.approx(harmonics["runout"], abs=1e-9)  # a bearing makes them of either
    assert set(stays) < set(TONES)


def test_evidence_is_summed_by_family():
    found = [spin(0, 3000.0, 1e-6), Sighting(0, "pickup 50 Hz", 1, 50.0, 1e-7, 1e-9, 1e-5, 40.0),
             Sighting(1, "pickup 60 Hz", 1, 60.0, 1e-7, 1e-9, 1e-5, 30.0),
             Sighting(1, "foreign", 1, 71.0, 1e-7, 1e-9, 1e-5, 25.0)]  # fmt: skip
    assert evidence(found) == {"spin": 1e4, "pickup": 70.0, "foreign": 25.0}


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


def sighting(family, harmonic, frequency, record=0):
    return Sighting(record, family, harmonic, frequency, 1e-7, 1e-9, 1e-5, 50.0)


def test_near_the_mains_a_tone_is_of_one_family():
    """At 3008 rpm what lies at 50.13 and 150.4 Hz is the rotor's alone; one that only the mains explain keeps both."""
    e = type("E", (), {"speed_rpm": 3008.0, "fundamental": 2.0})
    problem = type("P", (), {"parts": [type("Q", (), {"record": type("R", (), {"experiment": e})})]})
    turning = [sighting("spin", 1, 50.13), sighting("spin", 3, 150.4)]
    assert _one_family(problem, [*turning, sighting("pickup 50 Hz", 1, 50.1)]) == turning
    both = [*turning, sighting("pickup 60 Hz", 1, 60.0)]
    assert _one_family(problem, both) == both
    mains = [sighting("pickup 50 Hz", 1, 50.1), sighting("pickup 60 Hz", 1, 60.0)]
    assert _one_family(problem, [*mains, sighting("spin", 1, 50.1)]) == mains


def test_what_modes_need_to_ring_out_groups_their_lanes():
    slow = Point({"sensor_resonance": {"frequency": 40.0, "damping_ratio": 0.01, "coupling": 0.05}}, {})
    fast = Point({"support_resonance": {"frequency": 400.0, "damping_ratio": 0.05, "mass_ratio": 0.05}}, {})
    plain = Point(effect("delay", 1e-5), {})
    assert settling(plain) == 0.0
    assert np.exp(-settling(slow) * 2 * np.pi * 40 * 0.01) == pytest.approx(1.5e-3, rel=0.01)
    groups = together([slow, plain, fast, slow], 0.5, False)
    assert [which for _, which in groups] == [[1], [2], [0, 3]]
    anyway = together([slow, plain, fast, slow], 0.5, False, 0.3)  # s, which is more than the fast one needs
    assert [which for _, which in anyway] == [[1, 2], [0, 3]] and anyway[1] == groups[2]
    assert all(
        lasts >= settling(p) for (lasts, _), which in groups for p in ([slow, plain, fast, slow][i] for i in which)
    )


@pytest.mark.slow
def test_a_mode_has_rung_out_where_it_is_looked_at(tmp_path):
    """A sharp mode that the nominal loop knows nothing of: the period predicted is that of a record as long again."""
    problem = assemble([r for r in read_records(campaign(tmp_path / "c", names=("base",)))[1]])
    mode = Point({"sensor_resonance": {"frequency": 37.0, "damping_ratio": 0.012, "coupling": 0.1}}, {})
    steady = residuals([problem.parts[0].predictor], problem.parts[0].predictor.lanes([mode]), 2 * settling(mode))[0]
    whitened = steady[..., problem.parts[0].used] * (np.sqrt(2) / problem.parts[0].noise[..., problem.parts[0].used])
    (whitened,) = problem.nuisances.clear(whitened.reshape(1, -1))  # without what forms of stated constants may do
    found, hasty = (problem.simulate([mode], settled)[0] for settled in (True, False))
    size = abs(whitened).max()
    assert abs(found - whitened).max() < 5e-3 * size < 0.1 * abs(hasty - whitened).max()


def test_a_tone_on_a_higher_harmonic_of_what_is_seen_belongs_to_it():
    """Distorted mains: the fifth harmonic of 50 Hz is no foreign vibration, but only where the mains is seen."""
    problem = _Problem(0.0)
    record = problem.parts[0].record
    record.experiment.fundamental, record.experiment.recorded_per_period = 2.0, 1000
    record.series = {"displacement": np.zeros((1, 6000))}
    mains = replace(sighting("pickup 50 Hz", 1, 49.95), chi2=900.0)
    fifth, other = sighting("foreign", 1, 249.7), sighting("foreign", 1, 223.0)
    named = replace(fifth, family="pickup 50 Hz", harmonic=5)
    assert _higher_harmonics(problem, [mains, fifth, other]) == [mains, named, other]
    assert _higher_harmonics(problem, [fifth, other]) == [fifth, other]
    louder = replace(fifth, chi2=2000.0)
    assert _higher_harmonics(problem, [mains, louder]) == [mains, louder]
