"""Windows of lines: noise told without bias, transients and drift projected out, misfits as an F distribution."""

import numpy as np
import pytest
from scipy import stats

from estimation.lines.line_windows import TERMS, WIDTH, line_windows

RATE, SAMPLES = 2000.0, 8000


def test_white_noise_has_its_variance_whatever_runs_out_of_the_record():
    windows, rng = line_windows(SAMPLES, RATE, (2.0, 400.0)), np.random.default_rng(0)
    t = np.arange(SAMPLES)
    found, misfits = [], []
    for _ in range(60):
        residual = rng.normal(size=SAMPLES) + 50 * np.exp(-t / 100.0) + 1e-3 * t
        noise = windows.noise(windows.spectrum(residual), windows.spectrum(rng.normal(size=SAMPLES)))
        found.append(noise.variance)
        misfits.append(noise.misfit)
    assert np.mean(found) == pytest.approx(4 / SAMPLES, rel=0.02)
    middle = np.array(misfits)[:, 5:-5].ravel()
    assert noise.rank.max() == noise.rank.min() == TERMS and noise.freedom[10] == 5 * (WIDTH - 2 * TERMS)
    assert stats.kstest(middle, stats.f(2 * TERMS, 2 * noise.freedom[10]).cdf).pvalue > 1e-3


def test_directions_that_were_taken_out_of_some_residuals_cost_freedom_there_alone():
    windows, rng = line_windows(SAMPLES, RATE, (2.0, 400.0)), np.random.default_rng(2)
    removed, found = np.array([np.full(windows.count, 2.0), np.zeros(windows.count)]), []
    for _ in range(40):
        lines = windows.project(windows.spectrum(rng.normal(size=(2, SAMPLES))))
        lines[0, :, :2] = 0.0
        drive = windows.spectrum(rng.normal(size=SAMPLES))
        found.append(windows.noise(windows.lines(lines), drive, removed=removed).variance)
    assert np.mean(found, axis=(0, 2)) == pytest.approx([4 / SAMPLES] * 2, rel=0.03)


def test_what_a_smooth_response_explains_is_no_noise():
    windows, rng = line_windows(SAMPLES, RATE, (2.0, 400.0)), np.random.default_rng(1)
    drive, noise = rng.normal(size=SAMPLES), 0.01 * rng.normal(size=SAMPLES)
    response = np.convolve(drive, np.exp(-np.arange(40) / 8.0))[:SAMPLES]
    told = windows.noise(windows.spectrum(response + noise), windows.spectrum(drive))
    assert np.median(told.variance) == pytest.approx(1e-4 * 4 / SAMPLES, rel=0.1)
    assert np.median(told.misfit) > 1e3


@pytest.mark.parametrize("drives", [5, 6])
def test_noise_under_as_many_drives_as_two_axes_have_keeps_directions_of_its_own(drives):
    """Force, injection and reference along both axes: three terms of each would be all directions of a window."""
    windows, rng = line_windows(SAMPLES, RATE, (2.0, 400.0)), np.random.default_rng(6)
    found, misfits = [], []
    for _ in range(40):
        told = windows.noise(*(windows.spectrum(rng.normal(size=(n, SAMPLES))) for n in (1, drives)))
        found.append(told.variance)
        misfits.append(told.misfit)
    assert np.isfinite(found).all() and np.mean(found) == pytest.approx(4 / SAMPLES, rel=0.03)
    freedom = told.freedom[0, 10]
    assert np.mean(np.array(misfits)[:, 0, 5:-5]) == pytest.approx(freedom / (freedom - 1), rel=0.03)
    pull = windows.spectrum(np.convolve(drive := rng.normal(size=SAMPLES), np.exp(-np.arange(40) / 8.0))[:SAMPLES])
    others = windows.spectrum(rng.normal(size=(drives - 1, SAMPLES)))
    heard = windows.spectrum(0.01 * rng.normal(size=SAMPLES))
    left = windows.noise(pull + heard, np.concatenate([windows.spectrum(drive)[None], others]))
    assert np.median(left.variance) == pytest.approx(1e-4 * 4 / SAMPLES, rel=0.2)


def test_a_slow_noise_is_that_of_the_lowest_window_alone():
    """Its neighbours, and windows in which noise is as everywhere, are pooled as before."""
    windows, rng = line_windows(SAMPLES, RATE, (2.0, 400.0)), np.random.default_rng(8)
    slow = np.arange(SAMPLES // 2 + 1) * RATE / SAMPLES < windows.frequency[0, -1]
    found = []
    for _ in range(40):
        noise, drive = rng.normal(size=(2, SAMPLES))
        loud = np.fft.irfft(np.fft.rfft(noise) * np.where(slow, 5.0, 1.0), SAMPLES)
        found.append([windows.noise(windows.spectrum(own), windows.spectrum(drive)).variance for own in (loud, noise)])
    loud, plain = np.moveaxis(found, 0, 1)
    assert np.median(loud[:, 0]) == pytest.approx(25 * 4 / SAMPLES, rel=0.15)
    assert np.median(loud[:, 1]) == pytest.approx(4 / SAMPLES, rel=0.2)
    np.testing.assert_allclose(loud[:, 5:], plain[:, 5:], rtol=0.01)


def test_the_noise_beside_excitations_of_other_sizes_does_not_depend_on_their_units():
    """A force of 1 N and a reference of half a micrometre, which both move the rotor; a third one is silent."""
    windows, rng = line_windows(SAMPLES, RATE, (2.0, 400.0)), np.random.default_rng(7)
    force, reference = rng.normal(size=SAMPLES), 5e-7 * rng.normal(size=SAMPLES)
    reading = windows.spectrum(1e-6 * force + reference + 1e-9 * rng.normal(size=SAMPLES))
    drives = windows.spectrum(np.stack([force, reference, np.zeros(SAMPLES)]))
    told = windows.noise(reading, drives)
    assert (told.rank == 2 * TERMS).all()
    assert np.median(told.variance) == pytest.approx(1e-18 * 4 / SAMPLES, rel=0.1)
    scaled = windows.noise(reading, drives * np.array([1e-3, 1e6, 1.0])[:, None, None])
    np.testing.assert_allclose(scaled.variance, told.variance, rtol=1e-6)
    push = windows.spectrum(np.eye(1, SAMPLES)[0])  # at the first sample: a transient, the projection leaves rounding
    assert (windows.noise(reading, np.stack([*drives[:2], push])).rank == 2 * TERMS).all()


def test_projection_keeps_the_variance_of_each_coordinate_and_no_quadratic():
    windows = line_windows(SAMPLES, RATE, (2.0, 400.0))
    line = np.linspace(-1, 1, WIDTH)
    smooth = np.broadcast_to(3.0 - 2j * line + line**2, (windows.count, WIDTH))
    assert abs(windows.project(smooth)).max() < 1e-12
    white = np.random.default_rng(2).normal(size=(4000, 1, WIDTH)) + 0j
    coordinates = windows.project(white)[:, 0]
    np.testing.assert_allclose((coordinates.conj().T @ coordinates).real / 4000, np.eye(WIDTH - TERMS), atol=0.12)


def test_turned_coordinates_hold_the_excitation_in_the_first_ones_and_nothing_is_lost():
    windows, rng = line_windows(SAMPLES, RATE, (2.0, 400.0)), np.random.default_rng(3)
    drives, other = windows.spectrum(rng.normal(size=(2, SAMPLES))), windows.spectrum(rng.normal(size=SAMPLES))
    turned = windows.toward(drives)
    assert abs(turned.project(drives)[..., 2:]).max() < 1e-12 < abs(turned.project(drives)[..., :2]).min()
    np.testing.assert_allclose(turned.cleared(other), windows.cleared(other), atol=1e-12)
    power = np.sum(abs(windows.project(other)) ** 2, axis=-1)
    np.testing.assert_allclose(np.sum(abs(turned.project(other)) ** 2, axis=-1), power)
    np.testing.assert_allclose(turned.noise(other, drives).variance, windows.noise(other, drives).variance)


def test_steep_noise_has_its_own_variance_in_each_window_where_its_shape_is_known():
    windows, rng = line_windows(SAMPLES, RATE, (2.0, 400.0)), np.random.default_rng(4)
    steep = (20.0 / windows.frequency) ** 4
    shapes = np.stack([np.ones(windows.count), steep.mean(axis=-1)])
    found = []
    for _ in range(40):
        white, loud, drive = rng.normal(size=(3, windows.count, WIDTH, 2)) @ [1, 1j]
        found.append(windows.noise(white + np.sqrt(steep) * loud, drive, shapes).variance)
    np.testing.assert_allclose(np.mean(found, axis=0)[1:], 2 * (1 + shapes[1])[1:], rtol=0.15)


def test_a_record_too_short_says_how_long_it_must_be():
    with pytest.raises(ValueError, match="record at least 5"):
        line_windows(1000, 1000.0, (10.0, 30.0))
    with pytest.raises(ValueError, match="must increase"):
        line_windows(1000, 1000.0, (30.0, 10.0))


def test_what_the_excitation_explains_does_not_depend_on_its_unit():
    """A current in GA drives nothing else than one in A, and where it is silent it explains nothing."""
    windows, rng = line_windows(SAMPLES, RATE, (2.0, 400.0)), np.random.default_rng(5)
    drive, found = (
        windows.spectrum(rng.normal(size=SAMPLES)),
        windows.project(windows.spectrum(rng.normal(size=SAMPLES))),
    )
    drive[3] = 0.0
    (parts, rank), (small, same) = (windows.along(found, unit * drive) for unit in (1.0, 1e-9))
    assert rank[3] == 0 and not parts[3].any() and (np.delete(rank, 3) == TERMS).all()
    np.testing.assert_array_equal(rank, same)
    np.testing.assert_allclose(np.abs(small), np.abs(parts), atol=1e-12)
