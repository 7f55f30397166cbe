import dataclasses
from dataclasses import replace

import control as ct
import numpy as np
import pytest
import scipy

from estimation.iso_14839 import iso_14839_2_zone, iso_14839_3_zone
from estimation.stability_margins import TOGETHER, _quantiles, loop_gain, margin_arrays, margins, peak_sensitivity
from maglev_env.design.defaults import with_defaults
from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.rig.rig import axis_rig
from maglev_env.rig.rig_file import load_rig

LINES = np.unique(np.concatenate([[1], np.arange(5, 251, 5), np.round(np.geomspace(250, 2000, 41))])).astype(float)
QUANTITIES = (
    "peak_sensitivity",
    "peak_frequency",
    "gain_margin_high",
    "gain_margin_low",
    "phase_margin",
    "delay_margin",
    "disk_margin",
)


def loop(frequency, kp=8000.0, kd=5.2, ki=2000.0, delay=0.0):
    s = 2j * np.pi * np.asarray(frequency)
    controller = kp + kd * s / (1 + 1e-4 * s) + ki / (1 + 0.0318 * s)
    return controller * 5.7 / ((0.08012 * s**2 - 12500) * (1 + 1e-4 * s)) * np.exp(-delay * s)


def sensitivity(frequency, **gains):
    return 1 / (1 + loop(frequency, **gains))


def noisy(rng, clean, variance, shape=()):
    parts = rng.standard_normal((2, *shape, clean.size)) * np.sqrt(variance / 2)
    return clean + parts[0] + 1j * parts[1]


def test_agrees_with_python_control():
    s = ct.tf("s")
    plant = 5.7 / ((0.08012 * s**2 - 12500) * (1 + 1e-4 * s))
    system = (8000 + 5.2 * s / (1 + 1e-4 * s) + 2000 / (1 + 0.0318 * s)) * plant
    gains, phases, _, phase_at, gain_at, _ = ct.stability_margins(system, returnall=True)
    inside = (phase_at > 2 * np.pi) & (phase_at < 2 * np.pi * 2000)
    gains, phase_at = gains[inside], phase_at[inside] / (2 * np.pi)
    high, low = np.argmin(np.where(gains > 1, gains, np.inf)), np.argmax(np.where(gains < 1, gains, 0))
    dense = 2 * np.pi * np.geomspace(1, 2000, 10_001)
    magnitude = np.abs(1 / (1 + system(1j * dense)))
    disk = ct.disk_margins(system, dense, skew=0.0)[0]

    got = margins(LINES, sensitivity(LINES), np.zeros(LINES.size), draws=0)
    expected = {
        "peak_sensitivity": np.max(magnitude),
        "peak_frequency": dense[np.argmax(magnitude)] / (2 * np.pi),
        "gain_margin_high": gains[high],
        "gain_margin_high_frequency": phase_at[high],
        "gain_margin_low": gains[low],
        "phase_margin": phases[0],
        "phase_margin_frequency": gain_at[0] / (2 * np.pi),
        "delay_margin": np.radians(phases[0]) / gain_at[0],
        "disk_margin": disk,
    }
    for name, value in expected.items():
        assert getattr(got, name) == pytest.approx(value, rel=5e-3), name
    assert got.gain_margin_low_frequency == pytest.approx(phase_at[low], rel=0.02)  # the phase skims -180 deg here
    assert got.peak_sensitivity == pytest.approx(3.035, rel=1e-3)
    assert got.reasons == {} and got.intervals == {}


@pytest.mark.parametrize("gains", [{"kd": 12.0}, {"kd": 3.2, "delay": 5e-5}, {"kd": 2.6}, {"delay": 1.5e-4}])
def test_interpolation_is_accurate_from_flat_to_sharp_peaks(gains):
    fine = np.geomspace(1, 2000, 50_001)
    truth = margin_arrays(fine, sensitivity(fine, **gains))
    got = margin_arrays(LINES, sensitivity(LINES, **gains))
    for name in QUANTITIES:
        assert got[name] == pytest.approx(truth[name], rel=5e-3), name


def test_a_negative_phase_margin_counts_by_its_size_and_delay_by_the_way_round():
    frequency = np.geomspace(0.1, 10, 200)
    gain = np.exp(1j * np.radians(170.0)) / frequency  # 10 deg of lead away from -1, 350 deg of lag
    got = margin_arrays(frequency, 1 / (1 + gain))
    assert got["phase_margin"] == pytest.approx(10.0, rel=1e-6)
    assert got["delay_margin"] == pytest.approx(350 / 360, rel=1e-3)
    assert got["phase_margin_frequency"] == pytest.approx(1.0, rel=1e-3)


def test_what_the_band_does_not_hold_is_none_with_a_reason():
    high = LINES[LINES >= 200]
    got = margins(high, sensitivity(high), np.full(high.size, 1e-6), draws=100)
    assert got.phase_margin is None and got.delay_margin is None and got.phase_margin_frequency is None
    assert got.reasons["phase_margin"] == "|L| does not cross 1 between 200 and 2000 Hz"
    assert got.reasons["delay_margin"] == got.reasons["phase_margin"]
    assert got.gain_margin_low is None and "|L| > 1" in got.reasons["gain_margin_low"]
    assert got.gain_margin_high is not None
    assert got.peak_sensitivity == pytest.approx(abs(sensitivity(200.0)))
    assert "lower bound" in got.reasons["peak_sensitivity"] and "upper bound" in got.reasons["disk_margin"]
    low, up = got.intervals["peak_sensitivity"]
    assert low < got.peak_sensitivity and up is None
    assert got.intervals["peak_frequency"] == got.intervals["phase_margin"] == (None, None)
    assert got.intervals["disk_margin"][0] is None

    middle = LINES[(LINES > 50) & (LINES < 250)]
    got = margins(middle, sensitivity(middle), np.zeros(middle.size), draws=0)
    assert got.gain_margin_high is None
    assert got.reasons["gain_margin_high"].startswith("the phase of L does not cross -180 deg with |L| < 1")
    assert got.phase_margin is not None and "peak_sensitivity" not in got.reasons


def test_an_end_that_noise_hides_is_withheld():
    lines = np.append(LINES[LINES <= 105], 110.3)  # |L| crosses 1 at 110.27 Hz: noise often moves that out of the band
    clean = sensitivity(lines)
    got = margins(lines, clean, (0.03 * np.abs(clean)) ** 2)
    assert got.phase_margin == pytest.approx(18.99, rel=1e-3)
    for name in ("phase_margin", "delay_margin"):
        low, high = got.intervals[name]
        assert low <= getattr(got, name) and high is None


def test_without_noise_the_interval_is_the_value():
    got = margins(LINES, sensitivity(LINES), np.zeros(LINES.size), draws=100)
    for name in QUANTITIES:
        assert got.intervals[name] == pytest.approx((getattr(got, name),) * 2, rel=1e-9)


def test_a_batch_is_the_scalar_and_margins_is_both():
    rng = np.random.default_rng(0)
    clean = sensitivity(LINES)
    variance = (0.02 * np.abs(clean)) ** 2
    many = noisy(rng, clean, variance, (2, 3))
    batch = margin_arrays(LINES, many)
    peak, at = peak_sensitivity(LINES, many)
    for i, j in np.ndindex(2, 3):
        single = margins(LINES, many[i, j], variance, draws=0)
        for name, values in batch.items():
            if not name.startswith("gain_margin_high"):  # which `margins` reads from a smooth curve
                assert getattr(single, name) == pytest.approx(values[i, j], rel=1e-12)
        assert (single.peak_sensitivity, single.peak_frequency) == pytest.approx((peak[i, j], at[i, j]), rel=1e-12)


def test_many_loops_have_the_bits_of_one_and_none_has_none():
    clean = sensitivity(LINES)
    many = noisy(np.random.default_rng(0), clean, (0.02 * np.abs(clean)) ** 2, (2 * TOGETHER + 3,))
    batch = margin_arrays(LINES, many)
    for i in (0, TOGETHER - 1, TOGETHER, 2 * TOGETHER + 2):
        for name, value in margin_arrays(LINES, many[i]).items():
            np.testing.assert_array_equal(value, batch[name][i], err_msg=name)
    assert all(values.shape == (0,) for values in margin_arrays(LINES, many[:0]).values())


def test_the_interval_holds_its_value_and_depends_on_the_seed_only():
    clean = sensitivity(LINES, kd=12.0)  # a flat peak: the largest of many noisy lines is well too high
    variance = (0.03 * np.abs(clean)) ** 2
    record = noisy(np.random.default_rng(2), clean, variance)
    first, again, other = (margins(LINES, record, variance, seed=seed) for seed in (1, 1, 2))
    assert dataclasses.asdict(first) == dataclasses.asdict(again)
    assert first.intervals != other.intervals
    for name in QUANTITIES:
        low, high = first.intervals[name]
        assert (low is None or low <= getattr(first, name)) and (high is None or getattr(first, name) <= high)


def test_a_variance_of_few_periods_widens_the_interval_as_student_says():
    """Where the noise is small the ends are those of a t distribution, and no end of 400 draws is their extreme one."""
    clean = sensitivity(LINES)
    variance = (0.003 * np.abs(clean)) ** 2
    known, guessed = (margins(LINES, clean, variance, draws=1500, freedom=n).intervals for n in (np.inf, 8))
    for name in ("peak_sensitivity", "phase_margin", "delay_margin", "disk_margin"):
        wider = np.subtract(*guessed[name]) / np.subtract(*known[name])
        assert wider == pytest.approx(scipy.stats.t.ppf(0.975, 8) / scipy.stats.norm.ppf(0.975), rel=0.1), name


@pytest.mark.parametrize("gains", [{}, {"kd": 3.2, "delay": 5e-5}])
def test_an_interval_is_as_wide_as_readings_scatter(gains):
    """Peaks of 3 and of 7."""
    clean = sensitivity(LINES, **gains)
    variance = (0.01 * np.abs(clean)) ** 2
    ends = margins(LINES, clean, variance, draws=1500).intervals
    many = margin_arrays(LINES, noisy(np.random.default_rng(1), clean, variance, (400,)))
    for name in ("peak_sensitivity", "disk_margin", "phase_margin"):
        width = np.log(ends[name][1] / ends[name][0]) / (2 * scipy.stats.norm.ppf(0.975))
        assert width == pytest.approx(np.log(many[name]).std(), rel=0.15), name


def test_the_ends_leave_one_fortieth_outside_however_few_the_draws_are():
    """Of 39 draws and one that is to come, each is the smallest with a probability of one fortieth."""
    assert _quantiles(np.arange(1.0, 40.0)) == pytest.approx((1.0, 39.0))
    assert _quantiles(np.arange(1.0, 400.0)) == pytest.approx((10.0, 390.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gains", "relative"), [({}, 0.03), ({"kd": 3.2, "delay": 5e-5}, 0.03), ({"delay": 7.5e-5}, 0.02)]
)
def test_intervals_cover(gains, relative):
    records, rng = 80, np.random.default_rng(7)
    fine = np.geomspace(1, 2000, 20_001)
    truth = margin_arrays(fine, sensitivity(fine, **gains))
    clean = sensitivity(LINES, **gains)
    variance = (relative * np.abs(clean)) ** 2
    hits = dict.fromkeys(QUANTITIES, 0)
    for seed in range(records):
        got = margins(LINES, noisy(rng, clean, variance), variance, draws=150, seed=seed)
        for name in QUANTITIES:
            low, high = got.intervals[name]
            hits[name] += (low is None or low <= truth[name]) and (high is None or truth[name] <= high)
    assert {name: hit / records for name, hit in hits.items() if hit < 0.87 * records} == {}


@pytest.mark.parametrize(
    ("peak", "zone"), [(0.0, "A"), (2.999, "A"), (3.0, "B"), (3.999, "B"), (4.0, "C"), (4.999, "C"), (5.0, "D")]
)
def test_iso_14839_3(peak, zone):
    assert iso_14839_3_zone(peak) == zone


@pytest.mark.parametrize(
    ("peak", "zone"), [(0.0, "A"), (29.9, "A"), (30.0, "B"), (39.9, "B"), (40.0, "C"), (49.9, "C"), (50.0, "D")]
)
def test_iso_14839_2(peak, zone):
    assert iso_14839_2_zone(peak, 100.0) == zone


SHORT = np.array([1.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: loop_gain([1.0, 0.0]), "sensitivity"),
        (lambda: loop_gain([np.nan]), "sensitivity"),
        (lambda: peak_sensitivity(SHORT[:3], np.ones(3)), "frequency"),
        (lambda: peak_sensitivity(SHORT[::-1], np.ones(4)), "frequency"),
        (lambda: peak_sensitivity(SHORT - 1, np.ones(4)), "frequency"),
        (lambda: margin_arrays(SHORT, np.ones(5)), "sensitivity"),
        (lambda: margins(SHORT, np.ones((2, 4)), np.ones(4)), "sensitivity"),
        (lambda: margins(SHORT, np.ones(4), np.ones(3)), "variance"),
        (lambda: margins(SHORT, np.ones(4), -np.ones(4)), "variance"),
        (lambda: margins(SHORT, np.full(4, 0.5), np.ones(4), draws=10), "draws"),
        (lambda: iso_14839_3_zone(np.nan), "peak_sensitivity"),
        (lambda: iso_14839_2_zone(-1e-6, 1e-4), "peak_displacement"),
        (lambda: iso_14839_2_zone(1e-6, 0.0), "clearance"),
    ],
)
def test_bad_input_is_named(call, name):
    with pytest.raises(ValueError, match=name):
        call()


def test_a_peak_that_the_curve_alone_makes_is_called_unresolved():
    # A rotor on springs whose resonance passes between lines 10 Hz apart: the curve there peaks at 13, the loop at 1.1.
    rig = replace(load_rig("hmb_radial"), support_stiffness=6e4, protocol=None, gains=None, bounds={})
    own = axis_rig(with_defaults(rig), 0)
    coarse = np.arange(5.0, 2000.0, 10.0)
    found = []
    for f in (coarse, np.arange(2.0, 2000.0, 2.0)):
        s = loop_response(Experiment(own, own.gains, ()), f).sensitivity
        found.append(margins(f, s, np.full(f.size, 1e-8), draws=0))
    assert found[0].peak_sensitivity > 5 and "not resolved" in found[0].reasons["peak_sensitivity"]
    assert found[1].peak_sensitivity < 1.2 and "peak_sensitivity" not in found[1].reasons


def test_a_crossing_that_noise_moves_along_the_real_axis_is_bounded_by_where_it_may_lie():
    """Of an unstable plant with little damping: from rest to its peak, L lies along the real axis within its noise."""
    rng = np.random.default_rng(4)
    f = np.unique(np.r_[np.arange(5.0, 250.0, 5.0), np.geomspace(260.0, 2000.0, 42)])
    s = 1j * f / 33.0
    clean = 1 / (1 + (5.0 + 0.4 * s + 0.02 / s) / (s**2 - 1))
    true = margins(f, clean, np.zeros(f.size), draws=0).gain_margin_low
    held = []
    for _ in range(50):
        variance = (0.15 * np.abs(1 - clean)) ** 2
        noise = (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)) * np.sqrt(variance / 2)
        low, high = margins(f, clean + noise, variance, draws=200).intervals["gain_margin_low"]
        held.append((low or 0.0) <= true <= (high or np.inf))
    assert np.mean(held) > 0.88  # .68 where the crossing is taken to be near that of the smooth curve


def test_lines_that_noise_drowns_make_neither_margins_nor_ends_of_intervals():
    """A rotor on a spring with an integral, recorded from where S is lost in noise to where the loop gain is.

    It had a lower gain margin of its noise, peaks of |S| from 0.6 and phase margins up to 228 degrees in the intervals.
    """

    def clean(f):
        s = 2j * np.pi * f
        pid = 900 + 2000 / s + 7 * s / (1 + 1.5e-3 * s)
        return 1 / (1 + 8 * pid * np.exp(-1.5e-3 * s) / (0.45 * s**2 + 0.6 * s + 233))

    f, fine, rng = np.arange(0.25, 350.0, 0.5), np.geomspace(0.25, 350.0, 20_001), np.random.default_rng(6)
    true = margin_arrays(fine, clean(fine))
    assert np.isnan(true["gain_margin_low"])
    variance = (0.008 + 0.5 * (f / 350) ** 2.5) ** 2
    held = []
    for seed in range(12):
        got = margins(f, noisy(rng, clean(f), variance), variance, draws=200, seed=seed)
        assert got.gain_margin_low is None and "gain_margin_low" in got.reasons
        assert got.intervals["gain_margin_low"] == (None, None)
        for name in ("peak_sensitivity", "phase_margin", "delay_margin", "disk_margin"):
            low, high = got.intervals[name]
            held.append(low <= true[name] <= high)
            assert high < 1.2 * low, name
    assert np.mean(held) > 0.87


def test_a_peak_is_not_below_one():
    f, rng = np.geomspace(1.0, 2000.0, 60), np.random.default_rng(7)
    s = 2j * np.pi * f
    clean = 1 / (1 + 300 / (s * (1 + s / 2000)))  # |S| is 1.03 at most
    variance = np.full(f.size, 0.05**2)
    for seed in range(4):
        found = margins(f, noisy(rng, clean, variance), variance, draws=200, seed=seed)
        assert found.peak_sensitivity > 1 and found.intervals["peak_sensitivity"][0] >= 1


def test_a_peak_is_read_from_lines_that_are_noisy_there():
    """Where distortion is a fifth of |S|, L is told near -1 all the same.

    Left out, those lines had hidden the peak, or a curve across the gap had made one seven times as high.
    """
    rng, clean = np.random.default_rng(8), sensitivity(LINES, kp=5000.0, kd=4.2)
    true = margins(LINES, clean, np.zeros(LINES.size), draws=0)
    variance = (0.2 * np.abs(clean * (1 - clean)) / true.peak_sensitivity) ** 2
    for seed in range(20):
        found = margins(LINES, noisy(rng, clean, variance), variance, draws=200, seed=seed)
        low, high = found.intervals["peak_sensitivity"]
        assert 0.9 < found.peak_sensitivity / true.peak_sensitivity < 1.6
        assert 0.5 < low / true.peak_sensitivity < 1.2 and high < 1.6 * true.peak_sensitivity
        assert found.phase_margin is not None and found.gain_margin_low is not None


@pytest.mark.slow
def test_ends_of_intervals_hardly_depend_on_the_draws():
    """The same draws serve all recordings, so that by 400 of them disk margins had covered a percent less in all."""
    f = np.linspace(60.0, 200.0, 29)
    clean, variance = sensitivity(f), np.full(f.size, 0.01**2)
    ends = np.array([margins(f, clean, variance, seed=seed).intervals["disk_margin"] for seed in range(40)])
    assert np.all(ends.std(axis=0, ddof=1) < 0.023 * np.diff(ends).mean())  # of the width; .035 by 400 draws
