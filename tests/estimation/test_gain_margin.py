"""The factors by which a gain may rise and fall, against the poles of loops whose gain is changed."""

import numpy as np
import pytest

from estimation import stability_margins
from estimation.gain_margin import at_rest, gain_factors
from estimation.stability_margins import margin_arrays

FREQUENCY = np.geomspace(5.0, 2000.0, 90)
MASS, GAIN, STIFFNESS = 0.08, 5.7, -12.5e3
LAG, TD, TI = 2e-4, 1e-4, 0.0318


def polynomials(kp, ki, kd):
    """Numerator and denominator of L of a magnet under PID with a leaking integral, behind a lag."""
    pid = np.polyadd(
        np.polyadd(kp * np.convolve([TD, 1], [TI, 1]), kd * np.convolve([1, 0], [TI, 1])), [0, ki * TD, ki]
    )
    plant = np.convolve([MASS, 0, STIFFNESS], np.convolve([LAG, 1], np.convolve([TD, 1], [TI, 1])))
    return GAIN * pid, plant


def allowed(over, under, factors):
    """The first of some factors of the gain with which the loop is unstable."""
    return next(k for k in factors if np.roots(np.polyadd(under, k * over)).real.max() >= 0)


@pytest.mark.parametrize(
    "gains", [(8000.0, 2000.0, 5.2), (3330.0, 180.0, 4.98), (12000.0, 2000.0, 11.0), (5000.0, 0.0, 6.0)]
)
def test_the_gain_may_change_so_far_before_a_pole_is_unstable(gains):
    over, under = polynomials(*gains)
    assert np.roots(np.polyadd(under, over)).real.max() < 0
    s = 2j * np.pi * FREQUENCY
    sensitivity = 1 / (1 + np.polyval(over, s) / np.polyval(under, s))[None]
    up, down = gain_factors(FREQUENCY, sensitivity, margin_arrays(FREQUENCY, sensitivity))
    assert down[0] == pytest.approx(1 / allowed(over, under, np.geomspace(1, 0.02, 4000)), rel=0.05)
    assert up[0] == pytest.approx(allowed(over, under, np.geomspace(1, 100, 4000)), rel=0.02)


def test_lines_above_the_unstable_pole_are_extrapolated():
    """A pole of 5.3 Hz and lines from 10 Hz, as of a platform: L is -5 to -6 at the lowest line, -23 at rest."""
    lines = np.geomspace(10.0, 2000.0, 80)
    s = 2j * np.pi * lines
    loop = 3.92 * (7000.0 + 45.0 * s / (1 + 1e-4 * s)) / (1.06 * s**2 - 1180.0)
    sensitivity, variance = 1 / (1 + loop)[None], np.full((1, lines.size), 1e-8)
    value, error = at_rest(lines, sensitivity, variance)
    # The derivative's share of the lowest lines makes it cautious, by far less than the lowest line itself is.
    assert 2.3 * abs(loop[0].real) < value[0] < 3.92 * 7000.0 / 1180.0
    rng = np.random.default_rng(1)
    noise = np.sqrt(variance / 2) * (
        rng.standard_normal((400, lines.size)) + 1j * rng.standard_normal((400, lines.size))
    )
    assert at_rest(lines, sensitivity + noise)[0].std() == pytest.approx(error[0], rel=0.2)


@pytest.mark.parametrize("kd", [20.0, 150.0])
def test_the_error_at_rest_is_the_scatter_with_a_weak_and_a_strong_derivative(kd):
    """With the strong one the derivative's share of the loop gain at the highest of the lines is that of the rest."""
    lines = np.geomspace(4.0, 2000.0, 50)
    s = 2j * np.pi * lines
    sensitivity = 1 / (1 + 3.92 * (7000.0 + kd * s) / (1.06 * s**2 - 1180.0))[None]
    variance = 1e-8 * (lines / lines[0])[None] ** 3
    error = at_rest(lines, sensitivity, variance)[1]
    rng = np.random.default_rng(2)
    white = rng.standard_normal((2, 2000, lines.size)) * np.sqrt(variance / 2)
    drawn = at_rest(lines, sensitivity + white[0] + 1j * white[1])[0]
    assert np.isfinite(drawn).all() and drawn.std() == pytest.approx(error[0], rel=0.1)


def test_a_plant_that_stands_by_itself_may_lose_all_gain():
    s = 2j * np.pi * FREQUENCY
    loop = GAIN * (3000.0 + 5.0 * s) / (MASS * s**2 + 10.0 * s + 2e5) / (1 + LAG * s)
    sensitivity = 1 / (1 + loop)[None]
    _, down = gain_factors(FREQUENCY, sensitivity, margin_arrays(FREQUENCY, sensitivity))
    assert np.isnan(down[0])


def test_the_variance_of_the_loop_gain_is_that_of_its_draws(monkeypatch):
    """L = 1 / S - 1 has dL = -dS / S^2, where |S| is far from 1 too."""
    seen = {}

    def stop(f, centre, of_gain, middle, noise):
        seen["variance"] = of_gain
        raise StopIteration

    monkeypatch.setattr(stability_margins, "_drawn_margins", stop)
    f, centre = np.array([1.0, 10.0, 100.0]), np.array([0.1 + 0.05j, 2.0 - 1.0j, 1.0 + 0j])
    variance = 1e-6 * abs(centre) ** 2
    rng = np.random.default_rng(3)
    noise = np.sqrt(variance / 2) * (rng.standard_normal((20_000, 3, 2)) @ [1, 1j])
    with pytest.raises(StopIteration):
        stability_margins._intervals(f, centre, variance, {}, {}, noise)
    np.testing.assert_allclose(seen["variance"], (1 / (centre + noise)).var(axis=0), rtol=0.05)
