"""When a command steps after its readings, from a current that is integrated in fine steps."""

import numpy as np
import pytest

from estimation.lines.periods import LineStatistics
from maglev_env.evaluation.late_step import UNKNOWN, flowing_lag, sampled_lag, step_after_reading

FINE, SAMPLES, RATE = 200, 512, 1000.0
LINES = np.arange(3, 120, 7)
X = LINES / SAMPLES


def currents(lag: float, late: float, gain: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lines of a command, of the current read at its ticks, and of the current as it flows; explicit steps in time."""
    rng = np.random.default_rng(3)
    command = np.cos(2 * np.pi * X[:, None] * np.arange(SAMPLES) + rng.uniform(0, 6.3, LINES.size)[:, None]).sum(0)
    applied, shift = np.repeat(command, FINE), round(late * FINE)
    applied, now, flows = np.tile(np.roll(applied, shift), 2), 0.0, []
    keep = np.exp(-1 / (lag * FINE))
    for target in applied:
        flows.append(now)
        now = gain * target + (now - gain * target) * keep
    last = np.array(flows[SAMPLES * FINE :])  # the second period is settled
    fine = np.fft.fft(last)[LINES] / last.size
    return (np.fft.fft(command)[LINES] / SAMPLES, np.fft.fft(last[::FINE])[LINES] / SAMPLES, fine)


@pytest.mark.parametrize(("lag", "late"), [(0.5, 0.0), (0.5, 0.3), (1.5, 0.75), (0.2, 0.9), (1.0, 1.25)])
def test_both_responses_are_those_of_a_current_in_time(lag, late):
    command, read, flows = currents(lag, late)
    assert sampled_lag(X, lag, late) * command == pytest.approx(read, rel=1e-6)
    assert flowing_lag(X, lag, late) * command == pytest.approx(flows, rel=2e-3)


@pytest.mark.parametrize(("lag", "late"), [(0.5, 0.0), (0.6, 0.4), (1.2, 0.75), (1.0, 1.25)])
def test_a_recorded_command_tells_when_it_steps(lag, late):
    command, read, _ = currents(lag, late, 0.97)
    rng, noise = np.random.default_rng(1), 1e-4 * abs(read).max()
    read = read + noise * (rng.standard_normal(X.size) + 1j * rng.standard_normal(X.size)) / np.sqrt(2)
    covariance = np.zeros((2, 2, X.size), complex)
    covariance[0, 0] = noise**2
    names = ("current", "command")
    statistics = LineStatistics(X * RATE, LINES, names, np.stack([read, command]), covariance, 10)
    found, sd = step_after_reading(statistics, RATE, 1.05 * lag / RATE, 0.1)
    assert sd < 0.1
    assert abs((found - late + 0.5) % 1.0 - 0.5) < 3 * sd
    alone = LineStatistics(X * RATE, LINES, names[:1], read[None], covariance[:1, :1], 10)
    assert step_after_reading(alone, RATE, lag / RATE, 0.1) == (0.0, UNKNOWN)


@pytest.mark.slow
def test_the_moment_of_a_step_scatters_as_its_error_says():
    lag, late, names = 0.8, 0.4, ("current", "command")
    command, read, _ = currents(lag, late)
    noise, rng = 3e-3 * abs(read).max(), np.random.default_rng(7)
    covariance = np.zeros((2, 2, X.size), complex)
    covariance[0, 0] = noise**2
    found = []
    for _ in range(40):
        drawn = read + noise * (rng.standard_normal(X.size) + 1j * rng.standard_normal(X.size)) / np.sqrt(2)
        statistics = LineStatistics(X * RATE, LINES, names, np.stack([drawn, command]), covariance, 10)
        found.append(step_after_reading(statistics, RATE, lag / RATE, 1e-6))
    at, errors = np.array(found).T
    assert abs(at.mean() - late) < 4 * at.std() / np.sqrt(40)
    assert np.median(errors) == pytest.approx(at.std(), rel=0.3)


def test_the_noise_that_a_fit_leaves_is_counted_per_value_that_it_did_not_fit():
    """Noise three times as large as claimed: of 5 lines, 10 numbers are fitted with a gain and a moment."""
    lag, late, rng = 0.8, 0.4, np.random.default_rng(5)
    command, read, _ = (values[:5] for values in currents(lag, late))
    noise, ratios = 1e-3 * abs(read).max(), []
    for _ in range(24):
        drawn = read + noise * (rng.standard_normal(5) + 1j * rng.standard_normal(5)) / np.sqrt(2)
        found = []
        for claimed in (noise / 3, 30 * noise):  # noise that is less than claimed does not narrow the error
            covariance = np.zeros((2, 2, 5), complex)
            covariance[0, 0] = claimed**2
            lines = LineStatistics(
                X[:5] * RATE, LINES[:5], ("current", "command"), np.stack([drawn, command]), covariance, 10
            )
            found.append(step_after_reading(lines, RATE, lag / RATE, 1e-6)[1] / claimed)
        ratios.append((found[0] / found[1]) ** 2)
    assert np.mean(ratios) == pytest.approx(9.0, rel=0.25)
