"""What the best explanation leaves beyond noise, on linear problems drawn for the test."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimation.lines.line_windows import KEPT, WIDTH, LineWindows
from sim2real.judgement import dispersion
from sim2real.judgement.dispersion import NOISE_ALONE, ChiSquare, Dispersion, _left, dispersion_of
from sim2real.recorded.open_record import OpenRecord
from sim2real.search.fit import Fit
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


@pytest.mark.parametrize("inputs", [1, 4])
def test_noise_that_few_directions_tell_is_no_gap(monkeypatch, inputs):
    """Four inputs that vary leave six of eighteen directions of a window to tell the noise."""
    rng, count = np.random.default_rng(3), 40
    windows = LineWindows(4 * count * WIDTH, 1.0, 1, count)
    record = object.__new__(OpenRecord)
    for key, value in (("instrument", None), ("windows", windows), ("upstream", ()), ("every", 1)):
        object.__setattr__(record, key, value)
    drives = rng.standard_normal((inputs, count, WIDTH)) + 1j * rng.standard_normal((inputs, count, WIDTH))
    monkeypatch.setattr(OpenRecord, "drives", property(lambda self: drives))
    # Lost commands may scatter twice as much along the excitation as elsewhere.
    monkeypatch.setattr(dispersion, "louder_along", lambda part, record, lost: np.full((1, count), 2.0))
    found = []
    for _ in range(150):
        noise = rng.standard_normal((1, 1, count, WIDTH)) + 1j * rng.standard_normal((1, 1, count, WIDTH))
        sd = np.sqrt(windows.noise(noise, drives).variance)[..., None]
        residual = (windows.project(noise) / sd * np.sqrt(2)).reshape(-1)
        part = SimpleNamespace(record=record, measured=np.zeros((1, 1, count * KEPT)), used=np.ones(count * KEPT, bool))
        found.append(_left(part, residual))
        assert _left(part, residual, 0.4).value == pytest.approx(found[-1].value / 2)
    value, freedom = np.array([f.value for f in found]), found[0].freedom
    expected = np.sqrt(2 * freedom * (1 + 3 * inputs / (KEPT - 3 * inputs)))
    assert value.mean() == pytest.approx(freedom, abs=4 * expected / np.sqrt(150))
    assert value.std() == pytest.approx(expected, rel=0.25)
    assert all(f.ratio(0.0) == 1.0 for f in found)
