"""The warming body against its differential equation, and what readings of it tell."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from maglev_env.design.thermal import ThermalMass, final_rise, fit_rise

BODY = ThermalMass(capacity=800.0, resistance=2.5)
DURATION = 7200.0


def test_temperature_solves_the_balance_of_heat():
    time = np.linspace(0, 3 * BODY.time_constant, 40)
    run = solve_ivp(lambda _, x: (9.0 - (x - 22.0) / 2.5) / 800.0, (0, time[-1]), [30.0], "DOP853", time, rtol=1e-11)
    np.testing.assert_allclose(BODY.temperature(time, 9.0, 22.0, start=30.0), run.y[0], rtol=1e-7)
    assert BODY.temperature(0.0, 9.0, 22.0) == 22.0
    assert BODY.temperature(1e6, 9.0, 22.0) == pytest.approx(22.0 + 9.0 * 2.5)


def test_one_reading_gives_a_curve_of_bodies_that_all_pass_through_it():
    tau = np.geomspace(100.0, 1e6, 30)
    for ends, t in zip(final_rise(18.0, DURATION, tau), tau, strict=True):
        body = ThermalMass(capacity=t, resistance=1.0)
        assert body.temperature(DURATION, ends, 22.0) == pytest.approx(40.0)
        assert ends >= 18.0 and ends / t >= 18.0 / DURATION
    assert final_rise(18.0, DURATION, 100.0) == pytest.approx(18.0, rel=1e-6)
    assert final_rise(18.0, DURATION, 1e6) / 1e6 == pytest.approx(18.0 / DURATION, rel=0.01)
    with pytest.raises(ValueError, match="time_constant"):
        final_rise(18.0, DURATION, 0.0)


def test_bent_readings_give_both_unknowns():
    time = np.arange(0, 7201, 300.0)
    assert fit_rise(time, BODY.temperature(time, 9.0, 22.0), 22.0) == (
        pytest.approx(22.5, rel=1e-5),
        pytest.approx(2000.0, rel=1e-5),
    )
    slow = ThermalMass(capacity=4000.0, resistance=2.5)
    assert fit_rise(time, slow.temperature(time, 9.0, 22.0), 22.0) == (
        pytest.approx(22.5, rel=1e-4),
        pytest.approx(1e4, rel=1e-4),
    )


def test_noise_scatters_a_fit_about_the_truth():
    rng, time = np.random.default_rng(4), np.arange(0, 7201, 120.0)
    clean = BODY.temperature(time, 9.0, 22.0)
    fits = np.array([fit_rise(time, clean + rng.normal(0, 0.2, time.size), 22.0) for _ in range(200)])
    error = fits.mean(axis=0) / (22.5, 2000.0) - 1
    assert np.abs(error).max() < 0.01
    assert 0.002 < fits[:, 0].std() / 22.5 < 0.02


def test_readings_that_cannot_tell_are_refused():
    with pytest.raises(ValueError, match="assume a time constant"):
        fit_rise([0.0, DURATION], [22.0, 40.0], 22.0)
    time = np.arange(0, 7201, 600.0)
    with pytest.raises(ValueError, match="too straight"):
        fit_rise(time, 22.0 + 18.0 * time / DURATION, 22.0)
    with pytest.raises(ValueError, match="capacity"):
        ThermalMass(0.0, 1.0)
