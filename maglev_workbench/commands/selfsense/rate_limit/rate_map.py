"""The lowest stable sampling rate over PI gains, and checks of some of them by simulation."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.rig.rig import Rig
from maglev_workbench.commands.selfsense.rig_sensor import DISSERTATION_RATE
from selfsense.design import PIDesign, assess, design_pi, with_gains
from selfsense.linear import linearise, strongest_drive
from selfsense.rate_limit import gains_with_limit, lowest_stable_rate, sampling_rates
from selfsense.sensor import SelfSensor
from selfsense.simulate import simulate

CLAIMED, REFUSED = 165e3, 160e3  # Hz: rates at which the dissertation's simulation runs, and does not (7.2, point 6)
POINTS = 48  # of kp and of ki
CHECKED = (4, 12, 20, 28, 36, 44)  # of them are simulated too, along both axes
STEPS = POINTS + len(CHECKED)  # of the progress bar
AT = 4000.0  # Hz, of a lag
_LOOP = np.geomspace(0.2, 7.0, POINTS)  # kp times the path's gain
_INTEGRAL = np.geomspace(5e2, 1.2e5, POINTS)  # 1/s, ki times the path's gain
_CORNERS = np.geomspace(10.0, 60e3, 61)  # Hz, of the PI controllers along a limit
_DESIGNS = ((20.0, 1.0), (50.0, 1.0), (55.0, 2.9))  # degrees of lag at AT, dB of droop
_STARTS = (0.08, 0.3, 1.0, 1.8)  # of the rest gap: where a simulated estimate begins
_SECONDS = (0.05, 0.5)  # simulated, at least and at most
_ALIKE, _SWINGING = 0.01, 0.5  # of the gap: estimates agree; of the range: they still run from end to end


@dataclass(frozen=True)
class Limit:
    """Gains (n,) up to which a rate (Hz) is stable; (n,) in degrees: the lag at AT and the phase margin that they leave
    at the rig's rate, and the margin at the dissertation's; nan where they are not stable there."""

    rate: float
    kp: np.ndarray
    ki: np.ndarray
    lag: np.ndarray
    margin: np.ndarray
    margin_in_d: np.ndarray


@dataclass(frozen=True)
class Gains:
    """Gains kp (m/A) and ki (m/(A s)), the lag (deg) that they were designed for if any, their lowest stable rate (Hz,
    nan: none), and what they bring at the rig's rate (None where they are not stable there). settles: simulated at the
    lowest rate, and at the next lower one (None where there is none)."""

    name: str
    asked_lag: float | None
    kp: float
    ki: float
    lowest: float
    design: PIDesign | None
    settles: tuple[bool | None, bool | None]


@dataclass(frozen=True)
class RateMap:
    """gain (A/m): of the path, at rest; kp (POINTS,) and ki (POINTS,): of the map; lowest (POINTS, POINTS) by kp and
    ki, Hz, nan where the highest of rates (k,) is not stable. limits by rate (Hz), empty where it is not possible.
    designs: the rig's own and those of some lags; claimed: gains of the map whose lowest rate is CLAIMED; checks: other
    points of the map."""

    rig: Rig
    sensor: SelfSensor
    gain: float
    rates: np.ndarray
    kp: np.ndarray
    ki: np.ndarray
    lowest: np.ndarray
    limits: Mapping[float, Limit]
    designs: tuple[Gains, ...]
    claimed: tuple[Gains, ...]
    checks: tuple[Gains, ...]


def map_rates(rig: Rig, sensor: SelfSensor, progress: Callable[[], None] = lambda: None) -> RateMap:
    """The map of a rig's sensor.

    Raises:
        ValueError: The sensor cannot be linearised.
    """
    rates = np.array([r for r in sampling_rates(sensor.supply, sensor.acquisition.rate) if _possible(sensor, r)])
    if rates.size == 0:
        raise ValueError(
            f"acquisition: between twice the PWM frequency and {sensor.acquisition.rate:g} Hz there is no rate that "
            "the forward path can be sampled at; raise sample_rate"
        )
    gain = float(np.abs(linearise(sensor, strongest_drive(sensor.supply)).forward(0.0)))
    kp, ki = _LOOP / gain, _INTEGRAL / gain
    parts = []
    for part in np.array_split(kp, max(1, kp.size // 4)):
        parts.append(lowest_stable_rate(sensor, part, ki, rates))
        for _ in part:
            progress()
    lowest = np.concatenate(parts)
    limits = {}
    for rate in (CLAIMED, REFUSED):
        try:
            limits[rate] = _limit(sensor, rate)
        except ValueError:  # not a rate that this supply and forward path can be sampled at
            limits = {}
            break
    designs = [_gains("the rig's own", None, sensor, sensor.estimator.kp, sensor.estimator.ki, rates)]
    for lag, droop in _DESIGNS:
        try:
            found = design_pi(replace(sensor, coil=sensor.estimator.coil), lag, AT, droop)
        except ValueError:  # a path too slow for this lag
            continue
        designs.append(_gains(f"lag {lag:g}°, droop {droop:g} dB", lag, sensor, found.kp, found.ki, rates))
    name = f"stops at {CLAIMED / 1e3:g} kHz"
    claimed = [_gains(name, None, sensor, *g, rates) for g in _as_claimed(kp, ki, lowest)]
    checks = []
    for i in CHECKED:
        for j in CHECKED:
            settles = _settles(sensor, kp[i], ki[j], lowest[i, j], rates)
            checks.append(Gains("map", None, float(kp[i]), float(ki[j]), float(lowest[i, j]), None, settles))
        progress()
    return RateMap(rig, sensor, gain, rates, kp, ki, lowest, limits, tuple(designs), tuple(claimed), tuple(checks))


def as_predicted(g: Gains) -> bool:
    """Whether the simulation settles at the lowest stable rate (at none if there is none), and not below it."""
    at, below = g.settles
    return bool(at) == bool(np.isfinite(g.lowest)) and not below


def _limit(sensor: SelfSensor, rate: float) -> Limit:
    kp, ki = gains_with_limit(sensor, rate, _CORNERS)
    found = []
    for other in (sensor.acquisition.rate, DISSERTATION_RATE):
        own = _at(sensor, other)
        held = linearise(own, strongest_drive(sensor.supply)).growth(kp, ki) < 1
        for *gains, holds in zip(kp, ki, held, strict=True):
            d = assess(with_gains(own, *gains), AT) if holds else None
            found.append((d.lag, d.phase_margin) if d else (np.nan, np.nan))
    lag, margin = np.array(found).T.reshape(2, 2, -1)
    return Limit(rate, kp, ki, lag[0], *margin)


def _as_claimed(kp: np.ndarray, ki: np.ndarray, lowest: np.ndarray) -> list[tuple[float, float]]:
    """Up to three gains of the map whose lowest stable rate is CLAIMED, from mostly proportional to integral ones."""
    found = sorted(np.argwhere(lowest == CLAIMED).tolist(), key=lambda at: ki[at[1]] / kp[at[0]])
    chosen = [found[0], found[len(found) // 2], found[-1]] if len(found) > 2 else found
    return [(float(kp[i]), float(ki[j])) for i, j in chosen]


def _gains(name: str, asked_lag: float | None, sensor: SelfSensor, kp: float, ki: float, rates: np.ndarray) -> Gains:
    lowest = float(lowest_stable_rate(sensor, [kp], [ki], rates)[0, 0])
    held = linearise(sensor, strongest_drive(sensor.supply)).growth(kp, ki) < 1
    design = assess(with_gains(sensor, kp, ki), AT) if held else None
    return Gains(name, asked_lag, kp, ki, lowest, design, _settles(sensor, kp, ki, lowest, rates))


def _settles(
    sensor: SelfSensor, kp: float, ki: float, lowest: float, rates: np.ndarray
) -> tuple[bool | None, bool | None]:
    """Whether estimates settle at the lowest stable rate (without one: at the highest of rates), and at the next lower
    one, None where there is none."""
    own = with_gains(sensor, kp, ki)
    if not np.isfinite(lowest):
        return settled(_at(own, rates[-1])), None
    below = rates[rates < 0.999 * lowest]
    return settled(_at(own, lowest)), settled(_at(own, below[-1])) if below.size else None


def settled(sensor: SelfSensor) -> bool:
    """Whether the simulated estimate settles from initial gaps over its whole range, at half duty and without noise."""
    ideal = replace(sensor, acquisition=replace(sensor.acquisition, bits=0, noise=0.0))
    low, high = sensor.estimator.gap_range
    starts = np.clip(np.array(_STARTS) * sensor.gap, low + 1e-3 * (high - low), high - 1e-3 * (high - low))
    drive = strongest_drive(sensor.supply)
    linear = linearise(sensor, drive)
    # Ten time constants of the slowest pole, which decays or grows.
    pace = abs(np.log(linear.growth(sensor.estimator.kp, sensor.estimator.ki))) * linear.rate / linear.direct.size
    gap = np.full(round(np.clip(10 / pace, *_SECONDS) * linear.rate), sensor.gap)
    end = simulate([replace(ideal, gap=start) for start in starts], gap, drive).estimate[:, -gap.size // 10 :]
    return bool(
        np.ptp(end, axis=0).max() < _ALIKE * sensor.gap and np.ptp(end, axis=1).max() < _SWINGING * (high - low)
    )


def _at(sensor: SelfSensor, rate: float) -> SelfSensor:
    return replace(sensor, acquisition=replace(sensor.acquisition, rate=float(rate)))


def _possible(sensor: SelfSensor, rate: float) -> bool:
    try:
        _at(sensor, rate)
    except ValueError:  # the forward path or the simulated current does not exist at this rate
        return False
    return True
