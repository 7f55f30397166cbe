"""Mass, natural frequency and damping ratio of a whole record, by simulation."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_spectra import draw, expected_force_statistics, record, rig_experiment, two_channels

from estimation import modal
from estimation.modal import modal_estimate

F = np.arange(1.0, 81.0)
W = 2 * np.pi * F


def statistics(k, c, m, noise=1e-6, f=F):
    w = 2 * np.pi * f
    force = np.exp(0.1j * f**2)
    return two_channels(f, force, force / (k - m * w**2 + 1j * w * c), np.diag([noise**2 / k**2, noise**2]))


@pytest.mark.parametrize(("k", "c", "m"), [(2471.0, 3.108, 0.13), (134.5e3, 8.0, 0.79), (100.0, -0.01, 0.01)])
def test_exact_without_noise(k, c, m):
    e = modal_estimate(statistics(k, c, m, noise=0.0))
    assert (e.mass, e.stiffness, e.damping) == pytest.approx((m, k, c), rel=1e-7)
    assert e.natural_frequency == pytest.approx(np.sqrt(k / m) / 2 / np.pi, rel=1e-9)
    assert e.damping_ratio == pytest.approx(c / 2 / np.sqrt(k * m), rel=1e-7)


def test_a_record_that_no_mass_explains_is_refused_in_words(monkeypatch):
    fitted = modal._fit
    monkeypatch.setattr(modal, "_fit", lambda *args: replace(fitted(*args), ratio=10.0))  # whatever variance is added
    with pytest.raises(ValueError, match="no mass, stiffness and damping come near"):
        modal_estimate(statistics(2471.0, 3.1, 0.13))


def estimates(drawn, records):
    return [modal_estimate(record(drawn, i)) for i in range(records)]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hmb_axial", "pedestal"])
def test_standard_errors_cover(name):
    experiment, records = rig_experiment(name), 500
    rig = experiment.rig
    found = estimates(draw(expected_force_statistics(experiment), records, seed=21), records)
    k, c, m = rig.support_stiffness, rig.support_damping, rig.mass
    truth = {
        "mass": m,
        "stiffness": k,
        "damping": c,
        "natural_frequency": np.sqrt(k / m) / 2 / np.pi,
        "damping_ratio": c / 2 / np.sqrt(k * m),
    }
    for quantity, true in truth.items():
        value, se = (np.array([getattr(e, quantity + s) for e in found]) for s in ("", "_se"))
        assert abs(value.mean() - true) < 4 * value.std() / np.sqrt(records)
        assert value.std() / np.sqrt(np.mean(se**2)) == pytest.approx(1, abs=0.12)
        assert abs(np.mean(np.abs(value - true) < 1.96 * se) - 0.95) < 3 * np.sqrt(0.95 * 0.05 / records)
    assert np.mean([e.cost_ratio for e in found]) == pytest.approx(1, abs=0.04)


def covered(found, k, c, m):
    """Shares of the 95 % intervals of mass, stiffness and damping that hold the truth."""
    truth = {"mass": m, "stiffness": k, "damping": c}
    return [np.mean([abs(getattr(e, q) - v) < 1.96 * getattr(e, q + "_se") for e in found]) for q, v in truth.items()]


@pytest.mark.parametrize("periods", [6, 10])
def test_standard_errors_cover_where_the_noise_peaks_with_the_resonance(periods):
    """A disturbing force alone: the displacement's noise is that of the resonance, which is narrower than the pool."""
    k, c, m, f = 5e4, 5.0, 1.0, np.arange(1.0, 101.0)
    w = 2 * np.pi * f
    moved = 1 / (k - m * w**2 + 1j * w * c)
    noise = np.zeros((2, 2, f.size))
    noise[0, 0] = (0.05 * abs(moved)) ** 2 / periods
    expected = two_channels(f, np.exp(0.1j * f**2), np.exp(0.1j * f**2) * moved, noise, periods)
    found = estimates(draw(expected, 200, seed=31), 200)
    assert min(covered(found, k, c, m)) > 0.90
    assert np.mean([e.cost_ratio for e in found]) == pytest.approx(1, abs=0.05)
    assert np.mean([e.discrepancy > 0 for e in found]) < 0.04


def test_what_repeats_beside_noise_of_two_periods_is_seen():
    k, c, m, f = 5e4, 200.0, 1.0, np.arange(1.0, 101.0)
    w = 2 * np.pi * f
    force, noise = np.exp(0.1j * f**2), 1e-7 / np.sqrt(2)
    expected = two_channels(f, force, force / (k - m * w**2 + 1j * w * c), np.diag([noise**2, 0.0]), periods=2)
    drawn, rng = draw(expected, 60, seed=33), np.random.default_rng(34)
    white = rng.standard_normal((2, 60, f.size)) / np.sqrt(2)
    repeating = noise * (white[0] + 1j * white[1])  # as large as the noise
    bent = replace(drawn, mean=drawn.mean + np.stack([repeating, 0 * repeating], axis=1))
    found = estimates(bent, 60)
    assert np.mean([e.discrepancy > 0 for e in found]) > 0.9
    assert min(covered(found, k, c, m)) > 0.86
    assert np.mean([e.discrepancy > 0 for e in estimates(drawn, 60)]) < 0.06


def test_noise_of_the_displacement_does_not_bias_the_mass():
    s = statistics(2471.0, 3.108, 0.13)
    y = s.mean[0]
    quarter = 0.25 * np.mean(np.abs(y[40:])) ** 2  # above 40 Hz, where the mass shows
    loud = replace(s, covariance=np.array([[quarter, 0], [0, 1e-6]])[:, :, None] * np.ones(F.size))
    found = estimates(draw(loud, 100, seed=22), 100)
    mass = np.array([e.mass for e in found])
    assert abs(mass.mean() - 0.13) < 4 * mass.std() / 10
    assert mass.std() == pytest.approx(np.mean([e.mass_se for e in found]), rel=0.3)


def test_a_rig_with_two_modes_is_noticed_and_widens_the_standard_errors():
    s = statistics(2471.0, 3.108, 0.13, noise=1e-4)
    second = 1 / (0.4 * ((2 * np.pi * 60) ** 2 - W**2 + 2j * W * 10))
    bent = replace(s, mean=s.mean + np.array([second * s.mean[1], 0 * W]))
    plain, two = modal_estimate(record(draw(s, 1, 23), 0)), modal_estimate(record(draw(bent, 1, 23), 0))
    assert plain.cost_ratio < 1.5 and two.cost_ratio > 10
    assert two.mass_se > 3 * plain.mass_se
    assert abs(two.natural_frequency - np.sqrt(2471 / 0.13) / 2 / np.pi) < 2


@pytest.mark.parametrize(("k", "c", "m"), [(-2000.0, 3.0, 0.13), (2471.0, 3.0, -0.13), (-2471.0, 3.0, -0.13)])
def test_no_resonance_is_an_error(k, c, m):
    with pytest.raises(ValueError, match="no positive mass and stiffness"):
        modal_estimate(statistics(k, c, m))


def test_four_lines_are_needed():
    s = statistics(2471.0, 3.108, 0.13, f=np.array([10.0, 20.0, 30.0]))
    with pytest.raises(ValueError, match="3 lines; at least four"):
        modal_estimate(s)


def test_a_record_that_the_mass_explains_is_said_to_differ_in_one_of_a_hundred():
    drawn = draw(replace(statistics(2471.0, 3.108, 0.13, noise=1e-3, f=F[19:59:2]), periods=20), 800, seed=24)
    found = np.mean([e.discrepancy > 0 for e in estimates(drawn, 800)])
    assert abs(found - 0.01) < 3 * np.sqrt(0.01 * 0.99 / 800)
