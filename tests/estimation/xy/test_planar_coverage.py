"""Coverage of the two-axis 95 % intervals and the null of their fit test, by simulation."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_spectra import draw
from planar_records import (
    DAMPING,
    DIAGONALS,
    MASS,
    STIFFNESS,
    SYMMETRIC,
    VERTICAL,
    correlated,
    noise_levels,
    planar_record,
)
from scipy import stats

from estimation.xy.planar import eight_coefficients, row_sums

RECORDS = 2000
# The feedback of a magnetic bearing answers the displacement's noise with a force: N/m, x and y coupled.
FEEDBACK = np.array([[9e4 + 4e4j, 1e4], [-2e4j, 7e4 + 5e4j]])


def band_of(centre):
    return centre + np.arange(-7.0, 8.0), np.array([[centre - 7.5, centre + 7.5]])


def assert_covers(low, high, truth):
    """Each of the intervals (lanes, ...) holds the truth in 95 % of the lanes, three binomial deviations either way."""
    share = ((low <= truth) & (truth <= high)).mean(axis=0)
    assert np.abs(share - 0.95).max() < 3 * np.sqrt(0.95 * 0.05 / len(low)), share


def assert_all_cover(estimate, stiffness=STIFFNESS, damping=DAMPING):
    ok = estimate.identifiable[:, 0]
    assert ok.mean() > 0.9
    assert_covers(estimate.stiffness_low[ok, 0], estimate.stiffness_high[ok, 0], stiffness)
    assert_covers(estimate.damping_low[ok, 0], estimate.damping_high[ok, 0], damping)


def two_records(centre, ratio, records, seed, **options):
    f, bands = band_of(centre)
    levels = noise_levels(f, ratio)
    return [draw(planar_record(f, d, levels, **options), records, (seed, i)) for i, d in enumerate(DIAGONALS)], bands


def test_intervals_cover_and_the_fit_test_is_uniform():
    s, bands = two_records(70.0, 10, 600, seed=1)
    e = eight_coefficients(s, bands, MASS)
    assert_all_cover(e)
    assert e.informative.all()
    assert stats.kstest(e.fit_p[:, 0], "uniform").pvalue > 0.01
    # Standard errors are the spread; 600 draws know it to 3 %.
    assert e.stiffness.std(axis=0) == pytest.approx(np.median(e.stiffness_se, axis=0), rel=0.1)
    assert e.damping.std(axis=0) == pytest.approx(np.median(e.damping_se, axis=0), rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("centre", "ratio"), [(30.0, 50), (30.0, 3), (70.0, 3), (150.0, 10), (240.0, 50), (240.0, 3)])
def test_intervals_cover_at_every_frequency_and_noise(centre, ratio):
    s, bands = two_records(centre, ratio, RECORDS, seed=2)
    e = eight_coefficients(s, bands, MASS)
    assert_all_cover(e)
    assert e.informative.all()
    assert stats.kstest(e.fit_p[:, 0], "uniform").pvalue > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [50, 3])
@pytest.mark.parametrize("centre", [30.0, 240.0])
def test_intervals_cover_where_feedback_correlates_the_noise_and_the_axes_differ(centre, ratio):
    f, bands = band_of(centre)
    force, displacement = noise_levels(f, ratio)
    free = np.diag(np.array([0.5 * force, force, displacement, 0.3 * displacement]) ** 2)
    loop = np.eye(4, dtype=complex)
    loop[:2, 2:] = FEEDBACK
    covariance = (loop @ free @ np.conj(loop.T))[:, :, None]
    s = [replace(planar_record(f, d), covariance=np.repeat(covariance, f.size, 2)) for d in DIAGONALS]
    assert_all_cover(eight_coefficients([draw(r, RECORDS, (3, i)) for i, r in enumerate(s)], bands, MASS))


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [50, 3])
def test_intervals_cover_from_one_record_of_interleaved_lines(ratio):
    f, bands = band_of(70.0)
    direction = np.where(np.arange(f.size)[:, None] % 2, [[1.0, 0.0]], [[0.0, 1.0]])
    s = draw(planar_record(f, direction, noise_levels(f, ratio)), RECORDS, 4)
    assert_all_cover(eight_coefficients([s], bands, MASS))


@pytest.mark.slow
@pytest.mark.parametrize("periods", [2, 3, 16])
def test_coverage_does_not_depend_on_the_number_of_periods(periods):
    s, bands = two_records(150.0, 5, RECORDS, seed=5, periods=periods)
    e = eight_coefficients(s, bands, MASS)
    assert_all_cover(e)
    assert stats.kstest(e.fit_p[:, 0], "uniform").pvalue > 0.01


@pytest.mark.slow
def test_intervals_cover_from_records_that_differ():
    f, bands = band_of(70.0)
    force, displacement = noise_levels(f, 10)
    loud = draw(planar_record(f, VERTICAL, (force, displacement), correlated(5), periods=3), RECORDS, 6)
    faint = planar_record(f[::2] + 0.5, [0.03, 0.0], (0.1 * force, 0.1 * displacement), periods=12)
    assert_all_cover(eight_coefficients([loud, draw(faint, RECORDS, 7)], bands, MASS))


# Where coefficients vary over the band the intervals hold what the same band gives without noise, twenty standard
# errors from the mean stiffness; noise that differs tenfold between lines then makes the weights scatter more.
@pytest.mark.slow
@pytest.mark.parametrize("colour", [0.0, 1.2])
def test_intervals_cover_the_noise_free_fit_of_a_band_that_no_constants_fit(colour):
    f, bands = band_of(70.0)
    s = [planar_record(f, d, noise_levels(f, 100), correlated(6), tilt=0.05) for d in DIAGONALS]
    s = [replace(r, covariance=r.covariance * np.exp(colour * np.sin(f))) for r in s]
    truth = eight_coefficients(s, bands, MASS)
    e = eight_coefficients([draw(r, RECORDS, (8, i)) for i, r in enumerate(s)], bands, MASS)
    assert (np.abs(truth.stiffness[0] - STIFFNESS) / e.stiffness_se).max() > 10 and e.fit_p.max() < 1e-6
    assert_all_cover(e, truth.stiffness[0], truth.damping[0])


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [50, 3])
def test_row_sums_of_one_vertical_excitation_cover(ratio):
    f, bands = band_of(70.0)
    s = draw(planar_record(f, VERTICAL, noise_levels(f, ratio, **SYMMETRIC), **SYMMETRIC), 5 * RECORDS, 9)
    sums = row_sums(s, bands, MASS)
    for e in (sums.x, sums.y):
        for low, high, name in (
            (e.stiffness_low, e.stiffness_high, "stiffness"),
            (e.damping_low, e.damping_high, "damping"),
        ):
            truth = SYMMETRIC[name][0].sum()
            assert 0.935 < np.mean((low <= truth) & (truth <= high)) < 0.965
    assert sums.ratio.mean() == pytest.approx(1.0, abs=0.02)


def test_motion_well_above_its_noise_is_always_identifiable():
    for ratio in (50, 3):
        s, bands = two_records(70.0, ratio, 500, seed=10)
        assert eight_coefficients(s, bands, MASS, intervals=False).identifiable.all()


@pytest.mark.slow
@pytest.mark.parametrize("centre", [30.0, 70.0])
def test_intervals_cover_where_a_force_that_is_not_recorded_differs_from_line_to_line(centre):
    """As that of a law which is not linear: it repeats with the period, so that the noise does not tell of it."""
    f, bands = band_of(centre)
    s, rng = [planar_record(f, d, noise_levels(f, 1000)) for d in DIAGONALS], np.random.default_rng(11)
    w = 2 * np.pi * f[:, None, None]
    moves = np.linalg.inv(STIFFNESS - np.eye(2) * MASS * w**2 + 1j * w * DAMPING)
    records = []
    for i, one in enumerate(s):
        drawn = draw(one, RECORDS, (12, i))
        force = 0.02 * (rng.standard_normal((RECORDS, f.size, 2, 2)) @ np.array([1, 1j])) / np.sqrt(2)
        drawn.mean[:, 2:] += np.moveaxis((moves @ force[..., None])[..., 0], 1, 2)
        records.append(drawn)
    e = eight_coefficients(records, bands, MASS)
    for low, high, truth in ((e.stiffness_low, e.stiffness_high, STIFFNESS), (e.damping_low, e.damping_high, DAMPING)):
        share = ((low <= truth) & (truth <= high)).mean(axis=(0, 1))
        assert share.min() > 0.92, share
    # Damping is no wider than it has to be; stiffness is, for lines that a law moves together.
    assert share.max() < 0.985
    assert 1.3 < (e.stiffness_se / e.stiffness.std(axis=0)).mean() < 2.3
