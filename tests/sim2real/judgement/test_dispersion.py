"""What the best explanation leaves beyond noise, on linear problems drawn for the test."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.judgement.dispersion import NOISE_ALONE, ChiSquare, Dispersion, dispersion_of
from sim2real.search.fitting import Fit
from sim2real.search.hypotheses import Hypothesis

RECORDS, LINES = 3, 200
EFFECTS = ("actuator_gain", "negative_stiffness", "damping")


def fitted(rng, apart=0.0, level=1.0):
    """A fit of three effects to three recordings whose first parameter differs by so many standard errors; level: of
    the noise over what is assumed."""
    h = Hypothesis(EFFECTS, {})
    size = RECORDS * LINES
    jacobian = rng.standard_normal((h.size, size)) + 1j * rng.standard_normal((h.size, size))
    noise = level * (rng.standard_normal(size) + 1j * rng.standard_normal(size))
    own = np.repeat(np.arange(RECORDS) - 1, LINES) * apart / np.sqrt(2 * LINES)
    data = noise + 0.01 * jacobian.sum(axis=0) + own * jacobian[0]
    stacked = np.concatenate([jacobian.real, jacobian.imag], axis=1).T
    u = np.linalg.lstsq(stacked, np.concatenate([data.real, data.imag]), rcond=None)[0]
    fit = Fit(h, u, data - u @ jacobian, 0.0, jacobian)
    parts = [SimpleNamespace(record=SimpleNamespace(), place=slice(k * LINES, (k + 1) * LINES)) for k in range(RECORDS)]
    return dispersion_of(SimpleNamespace(parts=parts), fit)


def test_noise_alone_is_a_chi_square_of_the_parameters_that_recordings_may_have_of_their_own():
    rng = np.random.default_rng(0)
    found = [fitted(rng) for _ in range(300)]
    values = np.array([d.recordings.value for d in found])
    assert found[0].recordings.freedom == pytest.approx((RECORDS - 1) * len(EFFECTS), rel=0.02)
    assert values.mean() == pytest.approx(6.0, abs=4 * np.sqrt(12.0 / 300))
    assert values.var() == pytest.approx(12.0, rel=0.35)
    assert all(d.ratio() == 1.0 and d.beyond() == 0.0 for d in found)


def test_recordings_that_differ_are_told_and_another_form_excuses_them():
    found = fitted(np.random.default_rng(1), apart=8.0)
    assert found.recordings.value == pytest.approx(6 + 2 * 8.0**2, rel=0.3)
    assert found.ratio() == pytest.approx(found.recordings.value / 6, rel=0.05) and found.beyond() > 60
    assert found.ratio(allowed=found.recordings.value) == 1.0
    assert "disagree" in found.in_words()


def test_a_residual_that_is_too_large_is_told():
    found = fitted(np.random.default_rng(2), level=2.0)
    assert found.ratio() == pytest.approx(4.0, rel=0.2)
    assert "excitation" in Dispersion(ChiSquare(400.0, 100.0), NOISE_ALONE.recordings).in_words()
