"""The dissertation's least squares of two coupled axes against numpy's, and how far it can be trusted."""

import numpy as np
import pytest
from drawn_spectra import draw, record
from planar_records import BAND, MASS, STIFFNESS, SYMMETRIC, VERTICAL, F, diagonal_records, noise_levels, planar_record
from scipy.stats import t as student_t

from estimation.xy.planar import eight_coefficients
from estimation.xy.planar_least_squares import planar_least_squares


def test_least_squares_agrees_with_lstsq():
    s = [record(r, 0) for r in diagonal_records(20, 1, seed=13)]
    got = planar_least_squares(s, BAND, (0.92, 0.95))
    tables, targets = [], []
    for r in s:
        w, force = 2 * np.pi * r.frequency, np.linalg.norm(r.mean[:2], axis=0)
        x, y = r.mean[2:] / force
        table = np.stack([x, y, 1j * w * x, 1j * w * y], axis=1)
        target = (r.mean[:2] / force + np.array([[0.92], [0.95]]) * w**2 * r.mean[2:] / force).T
        tables += [table.real, table.imag]
        targets += [target.real, target.imag]
    design, target = np.concatenate(tables), np.concatenate(targets)
    theta, rss, _, _ = np.linalg.lstsq(design / design.std(0), target, rcond=None)
    freedom = 2 * 2 * F.size - 4
    for axis in range(2):
        expected = theta[:, axis] / design.std(0)
        se = np.sqrt(np.diag(np.linalg.inv(design.T @ design)) * rss[axis] / freedom)
        pairs = (("", expected), ("_se", se), ("_t", expected / se))
        for suffix, value in pairs:
            both = [getattr(got, name + suffix)[0, axis] for name in ("stiffness", "damping")]
            assert np.concatenate(both) == pytest.approx(value, rel=1e-6)
        significant = np.abs(expected / se) >= student_t.ppf(0.975, freedom)
        assert [*got.stiffness_significant[0, axis], *got.damping_significant[0, axis]] == significant.tolist()
        r2 = 1 - rss[axis] / np.sum((target[:, axis] - target[:, axis].mean()) ** 2)
        assert got.r2[0, axis] == pytest.approx(r2)
        assert got.r2_adjusted[0, axis] == pytest.approx(1 - (1 - r2) * (freedom + 3) / freedom)
    assert got.condition[0] == pytest.approx(np.linalg.cond(design / np.linalg.norm(design, axis=0)))


def test_least_squares_of_one_excitation_fits_well_and_means_only_its_row_sums():
    levels = noise_levels(F, 100, **SYMMETRIC)
    one = draw(planar_record(F, VERTICAL, levels, **SYMMETRIC), 300, 14)
    got = planar_least_squares([one], BAND, MASS)
    assert got.r2_adjusted.min() > 0.99
    sums = got.stiffness.sum(axis=-1)
    assert np.abs(sums / 129e3 - 1).max() < 0.02
    # Noise decides how a row's sum is shared out: with m w^2 on the own column the halves of k - m w^2 come out alike.
    inertia = MASS * np.mean((2 * np.pi * F) ** 2)
    halves = np.array([[129e3 + inertia, 129e3 - inertia], [129e3 - inertia, 129e3 + inertia]]) / 2
    assert np.abs(got.stiffness.mean(axis=0)[0] - halves).max() < 3e3
    exact = planar_least_squares([planar_record(F, VERTICAL, **SYMMETRIC)], BAND, MASS)
    assert exact.condition[0] > 1e12 or np.isnan(exact.stiffness).all()


def test_least_squares_is_exact_without_noise_and_pulled_by_it():
    exact = planar_least_squares(diagonal_records(np.inf), BAND, MASS)
    assert exact.stiffness[0] == pytest.approx(STIFFNESS, rel=1e-9) and exact.r2 == pytest.approx(1.0)
    noisy = diagonal_records(3, 400, seed=15)
    biased, unbiased = planar_least_squares(noisy, BAND, MASS), eight_coefficients(noisy, BAND, MASS)
    error = (biased.stiffness - STIFFNESS).mean(axis=0) / biased.stiffness.std(axis=0) * 20
    assert error[0, 0, 0] > 8 and error[0, 1, 1] > 8  # towards m w^2
    error = (unbiased.stiffness - STIFFNESS).mean(axis=0) / unbiased.stiffness.std(axis=0) * 20
    assert np.abs(error).max() < 4
