"""Designs of a rig's estimator: the wanted one, those for 20 and 50 degrees of lag, and their trade-off."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from maglev_env.rig.rig import Rig
from selfsense.bound import cramer_rao_density, forward_path_cost, noise_sweep
from selfsense.design import PIDesign, assess, design_pi, trade_off, with_gains
from selfsense.linear import tracking
from selfsense.sensor import Estimator, SelfSensor, samples_and_periods
from selfsense.simulate import simulate

REFERENCES = ((20.0, 1.0), (20.0, 2.9), (50.0, 1.0))  # degrees of lag, dB of droop
DROOPS = (1.0, 2.9)  # dB, of the trade-off's curves
MARGINS = np.arange(8.0, 90.1, 2.0)  # deg
STEPS = 7  # of the progress bar, at most
LINES = 14  # frequencies simulated, at most
_LOWEST, _MOTION = 100.0, 0.5e-6  # Hz and m of a simulated line


@dataclass(frozen=True)
class Candidate:
    """Gains with what they were designed for; lag (deg) and droop (dB) are None for gains that the rig states.

    design: what they bring to the rig's coil. noise: rms gap error (m) that the bound and the forward path's cost
    predict at the rig's current noise and bits; simulated_noise: the same simulated; both nan without noise and bits.
    response: estimated over true gap (n,) at frequency (n,) Hz by the linear model; simulated: the same (m,) at
    simulated_frequency (m,), switching edge by switching edge, read without noise.
    """

    name: str
    lag: float | None
    droop: float | None
    design: PIDesign
    noise: float
    simulated_noise: float
    frequency: np.ndarray
    response: np.ndarray
    simulated_frequency: np.ndarray
    simulated: np.ndarray


@dataclass(frozen=True)
class Study:
    """Candidates, the one asked for first; missing: why a column is not there; trade: the smallest lag over MARGINS
    by droop (dB); noise_density: rms gap error over the root of the noise bandwidth (m/sqrt(Hz)), nan without noise."""

    rig: Rig
    sensor: SelfSensor
    lag: float
    at: float
    droop: float
    candidates: tuple[Candidate, ...]
    missing: tuple[str, ...]
    trade: Mapping[float, PIDesign]
    noise_density: float

    def reference(self, lag: float, droop: float) -> Candidate | None:
        """The candidate that was designed for this lag (deg) and droop (dB); None if no gains reach it."""
        return next((c for c in self.candidates if (c.lag, c.droop) == (lag, droop)), None)


def study(
    rig: Rig, sensor: SelfSensor, lag: float, at: float, droop: float, progress: Callable[[], None] = lambda: None
) -> Study:
    """Design for a lag (deg) at a frequency (Hz) within a droop (dB), and all that belongs beside it.

    As for the rig itself, gains are those of the coil that the estimator believes in; what they bring is that of the
    rig's own. ValueError when no gains reach the lag asked for.
    """
    believed = replace(sensor, coil=sensor.estimator.coil)
    found = design_pi(believed, lag, at, droop)
    density = cramer_rao_density(sensor) * forward_path_cost(sensor) if sensor.acquisition.reading_noise else np.nan
    candidates = [_candidate(sensor, found, lag, at, droop, density)]
    progress()
    missing = []
    if rig.self_sensing.kp is not None:
        try:
            candidates.append(_candidate(sensor, sensor.estimator, None, at, None, density))
        except ValueError as error:  # not stable
            missing.append(f"the rig's own gains: {error}")
    for wanted, within in REFERENCES:
        if (wanted, within) != (lag, droop):
            try:
                found = design_pi(believed, wanted, at, within)
                candidates.append(_candidate(sensor, found, wanted, at, within, density))
            except ValueError as error:
                missing.append(f"{wanted:g}° within {within:g} dB: {str(error).partition(';')[0]}")
        progress()
    trade = {}
    for within in sorted({*DROOPS, droop}):
        trade[within] = trade_off(sensor, MARGINS, at, within)
        progress()
    return Study(rig, sensor, lag, at, droop, tuple(candidates), tuple(missing), trade, density)


def ideal_low_pass(corner: float, at: float, margins: np.ndarray) -> np.ndarray:
    """Lag (deg) at `at` Hz of a proportional controller around an ideal second-order low-pass (corner, Hz), (n,).

    Of the gain that leaves a phase margin (n,), deg: the hand calculation, without high-pass and sampling.
    """
    # At the crossover, u corners up, the low-pass lags by atan2(sqrt(2) u, 1 - u^2) = 180 - margin.
    cot = 1 / np.tan(np.radians(180 - np.asarray(margins, dtype=float)))
    u = (np.sqrt(2 * cot**2 + 4) - sqrt(2) * cot) / 2
    gain, v = np.sqrt(1 + u**4), at / corner
    return np.degrees(np.arctan2(sqrt(2) * v, 1 + gain - v**2))


def simulated_tracking(sensor: SelfSensor) -> tuple[np.ndarray, np.ndarray]:
    """Frequency (m,) Hz and estimated over true gap (m,) of the simulated sensor, at half duty, without noise.

    By a multisine of at most LINES lines below half the PWM frequency, less the estimate of a gap at rest: what creeps
    in both cancels.
    """
    rate, (cycle, _) = sensor.acquisition.rate, samples_and_periods(sensor)
    period = cycle * max(1, round(rate / _LOWEST / cycle))
    top = 0.48 * sensor.supply.frequency * period / rate
    lines = np.unique(np.geomspace(1, top, LINES).round().astype(int))
    phase = 2 * np.pi * np.outer(lines, np.arange(1, 4 * period + 1)) / period + np.arange(lines.size)[:, None] ** 2
    motion = _MOTION * np.cos(phase).sum(axis=0)
    ideal = replace(sensor, acquisition=replace(sensor.acquisition, bits=0, noise=0.0))
    estimate = simulate([ideal] * 2, sensor.gap + np.stack([motion, 0 * motion])).estimate
    out, into = (np.fft.rfft(w[-period:])[lines] for w in (estimate[0] - estimate[1], motion))
    return lines * (rate / period), out / into


def _candidate(
    sensor: SelfSensor, gains: PIDesign | Estimator, lag: float | None, at: float, droop: float | None, density: float
) -> Candidate:
    own = with_gains(sensor, gains.kp, gains.ki)
    design = assess(own, at)
    a = own.acquisition
    simulated = np.nan
    if np.isfinite(density):
        simulated = noise_sweep(own, [a.bits], [a.noise], amplitude=own.gap / 7)[0].rms
    frequency = np.geomspace(_LOWEST, own.supply.frequency / 2, 200)
    name = "the rig's own, kp and ki" if lag is None else f"≤ {lag:g}°, {droop:g} dB"
    return Candidate(
        name,
        lag,
        droop,
        design,
        density * sqrt(design.noise_bandwidth),
        simulated,
        frequency,
        tracking(own, frequency),
        *simulated_tracking(own),
    )
