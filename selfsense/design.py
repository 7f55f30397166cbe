"""Gains of the estimator's PI controller, from the phase margin of its open loop and the lag of its estimate.

The open loop is the sampled loop at half duty, where the ripple and with it the loop gain is largest. It lags more than
its low-pass: the high-pass delays the ripple's envelope, and an estimate acts one sample late. A smaller lag of the
estimate therefore costs phase margin, and the margin alone nearly determines the peak and the noise bandwidth.
"""

from dataclasses import astuple, dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from selfsense.linear import LinearSensor, controller_response, linearise, strongest_drive
from selfsense.sensor import SelfSensor

# Largest lag in degrees at this frequency in Hz, and droop in dB. At 35 degrees a varying duty moves the estimate a
# tenth as much as it moves the amplitude.
LAG, LAG_AT, DROOP = 35.0, 4000.0, 1.0
LEAST_MARGIN = 10.0  # smallest phase margin of a design, deg; below it the estimate rings
_GRID = 600  # frequencies of a curve
_INSIDE = 60  # frequencies below the one at which the lag is required
_CANDIDATES, _ZOOMS = 200, 3  # crossovers tried, and repetitions around the best of them


@dataclass(frozen=True)
class PIDesign:
    """PI gains and their properties; floats, or arrays (n,) of a trade-off.

    Attributes:
        kp: m/A.
        ki: m/(A s).
        crossover: Of the open loop, Hz.
        phase_margin: Of the open loop, deg.
        gain_margin: Of the open loop, a factor.
        bandwidth: Frequency at which estimated over true gap is 3 dB below its static value, Hz.
        lag: At the frequency designed for, deg.
        peak: Relative to the static value.
        noise_bandwidth: Integral of the squared response up to half the sampling rate, Hz.
    """

    kp: float | np.ndarray
    ki: float | np.ndarray
    crossover: float | np.ndarray
    phase_margin: float | np.ndarray
    gain_margin: float | np.ndarray
    bandwidth: float | np.ndarray
    lag: float | np.ndarray
    peak: float | np.ndarray
    noise_bandwidth: float | np.ndarray


def with_gains(sensor: SelfSensor, kp: float, ki: float) -> SelfSensor:
    """The sensor with PI gains kp (m/A) and ki (m/(A s))."""
    return replace(sensor, estimator=replace(sensor.estimator, kp=float(kp), ki=float(ki)))


def pi_gains(sensor: SelfSensor, crossover: float, phase_margin: float) -> tuple[float, float]:
    """Gains kp (m/A) and ki (m/(A s)) for a crossover (Hz) of the open loop with a phase margin (deg).

    Raises:
        ValueError: The required controller phase is outside the 0 to 90 degrees of lag of a PI controller.
    """
    linear = linearise(sensor, strongest_drive(sensor.supply))
    if not 0 < crossover < linear.rate / 2:
        raise ValueError(f"crossover = {crossover} Hz must be above 0 and below half of the {linear.rate:g} Hz sampled")
    forward = linear.forward(np.linspace(crossover / _INSIDE, crossover, _INSIDE))
    phase = phase_margin - 180 - float(np.degrees(np.unwrap(np.angle(forward)))[-1])
    kp, ki = _gains(forward[-1], crossover, phase_margin, linear.rate)
    if not (-90 < phase <= 0 and kp > 0 and ki >= 0):
        raise ValueError(
            f"a phase margin of {phase_margin:g} degrees at {crossover:g} Hz takes a controller of {phase:.0f} degrees "
            f"there; a PI has -90 to 0: {'raise' if phase < 0 else 'lower'} the crossover"
        )
    return float(kp), float(ki)


def design_pi(sensor: SelfSensor, lag: float = LAG, at: float = LAG_AT, droop: float = DROOP) -> PIDesign:
    """Gains with the largest phase margin whose estimate lags by at most `lag` degrees at `at` Hz.

    Up to that frequency the estimate stays within `droop` dB below its static value, so its bandwidth is larger than
    `at`. The more droop is allowed, the smaller the integral part: at 3 dB and a small lag almost none is left, and the
    estimate creeps. For 25 kHz, 250 kHz and the digital path, a lag of 50 degrees leaves 52 degrees of margin; a lag of
    20 degrees leaves 14, or 26 with 2.9 dB of droop.

    Raises:
        ValueError: No gains with 10 degrees of margin reach the lag.
    """
    band = _Band.of(sensor, at, droop)
    if not 0 < lag < 360:
        raise ValueError(f"lag = {lag} degrees must be in 0 .. 360")
    best, low, high = _smallest_lag(band, LEAST_MARGIN), LEAST_MARGIN, 90.0
    if best[0] > lag:
        reached = f"at best it lags {best[0]:.0f} degrees" if np.isfinite(best[0]) else "no gains stay within the droop"
        raise ValueError(
            f"no PI gains with {LEAST_MARGIN:g} degrees of phase margin bring the estimate's lag at {at:g} Hz to "
            f"{lag:g} degrees within {droop:g} dB: {reached}; allow more lag or droop, or raise the forward path's "
            "low-pass, the sampling rate or the PWM frequency"
        )
    while high - low > 0.01:
        middle = (low + high) / 2
        found = _smallest_lag(band, middle)
        if found[0] <= lag:
            best, low = found, middle
        else:
            high = middle
    return assess(with_gains(sensor, *best[1:]), at)


def trade_off(
    sensor: SelfSensor, margins: ArrayLike | None = None, at: float = LAG_AT, droop: float = DROOP
) -> PIDesign:
    """Gains with the smallest lag at `at` Hz for phase margins (n,) in degrees (by default 30 to 85), as arrays (n,).

    The droop is that of `design_pi`. Where no gains stay within it, everything but the phase margin is nan.
    """
    margins = np.arange(30.0, 86.0, 5.0) if margins is None else np.asarray(margins, dtype=float)
    band, rows = _Band.of(sensor, at, droop), []
    for margin in margins:
        lag, kp, ki = _smallest_lag(band, margin)
        none = PIDesign(*[np.nan] * len(fields(PIDesign)))
        found = assess(with_gains(sensor, kp, ki), at) if np.isfinite(lag) else none
        rows.append(astuple(replace(found, phase_margin=margin)))
    return PIDesign(*np.array(rows).T)


def assess(sensor: SelfSensor, at: float = LAG_AT) -> PIDesign:
    """Properties of a sensor's gains, with the lag at `at` Hz.

    Raises:
        ValueError: The gains are not stable.
    """
    linear = linearise(sensor, strongest_drive(sensor.supply))
    kp, ki = sensor.estimator.kp, sensor.estimator.ki
    if not linear.growth(kp, ki) < 1:
        raise ValueError(f"estimator: kp = {kp:g} m/A and ki = {ki:g} m/(A s) are not stable; lower them")
    f = np.unique(np.append(_curve(linear, _GRID), at))
    controller = controller_response(kp, ki, linear.rate, f)
    loop = controller * linear.forward(f)
    tracked = controller * linear.coil(f) / (1 + loop)
    gain = np.log(np.abs(loop))
    phase = np.degrees(np.unwrap(np.angle(loop)))
    crossover = _first_below(f, gain, 0.0)
    turned = _first_below(f, phase, -180.0)
    relative = np.abs(tracked) / _static(linear)
    return PIDesign(
        kp=kp,
        ki=ki,
        crossover=crossover,
        phase_margin=180 + _at(f, phase, crossover),
        gain_margin=float(np.exp(-_at(f, gain, turned))) if np.isfinite(turned) else np.inf,
        bandwidth=_first_below(f, np.log(relative), -3 * np.log(10) / 20),
        lag=float(-np.degrees(np.unwrap(np.angle(tracked)))[f == at][0]),
        peak=float(relative.max()),
        noise_bandwidth=float(np.trapezoid(np.abs(tracked) ** 2, f) + f[0] * np.abs(tracked[0]) ** 2),
    )


@dataclass(frozen=True)
class _Band:
    """Responses that a search for gains needs.

    These are the forward responses at possible crossover frequencies, up to where a proportional controller has no
    margin left; over all frequencies; and, with the coil's response, inside the band that must not droop below `least`.
    """

    linear: LinearSensor
    crossover: np.ndarray
    at_crossover: np.ndarray
    curve: np.ndarray
    over: np.ndarray
    inside: np.ndarray
    forward: np.ndarray
    coil: np.ndarray
    least: float

    @classmethod
    def of(cls, sensor: SelfSensor, at: float, droop: float) -> "_Band":
        linear = linearise(sensor, strongest_drive(sensor.supply))
        if not 0 < at < linear.rate / 2:
            raise ValueError(f"at = {at} Hz must be above 0 and below half of the {linear.rate:g} Hz sampled")
        if not 0 < droop < 3:
            raise ValueError(f"droop = {droop} dB must be above 0 and below 3, where the bandwidth ends")
        curve, inside = _curve(linear, _INSIDE * 2), np.linspace(at / _INSIDE, at, _INSIDE)
        over, least = linear.forward(curve), _static(linear) * 10 ** (-droop / 20)
        highest = min(_first_below(curve, np.unwrap(np.angle(over)), -np.pi), curve[-1])
        crossover = np.geomspace(highest / 50, highest, _GRID)
        at_crossover = linear.forward(crossover)
        return cls(
            linear, crossover, at_crossover, curve, over, inside, linear.forward(inside), linear.coil(inside), least
        )


def _smallest_lag(band: _Band, margin: float) -> tuple[float, float, float]:
    """Smallest lag (deg) at the end of the band for a phase margin (deg), inf if none; and its kp and ki."""
    rate, best = band.linear.rate, (np.inf, np.nan, np.nan)
    low, high = band.crossover[[0, -1]]
    for _ in range(_ZOOMS):
        crossover = np.geomspace(low, high, _CANDIDATES)
        forward = np.interp(crossover, band.crossover, band.at_crossover)
        kp, ki = _gains(forward, crossover, margin, rate)
        lag = np.full(_CANDIDATES, np.inf)
        allowed = (kp > 0) & (ki > 0)
        lag[allowed] = _lags(band, kp[allowed], ki[allowed])
        i = lag.argmin()
        if not lag[i] < best[0]:
            break
        best = (float(lag[i]), float(kp[i]), float(ki[i]))
        low, high = crossover[max(i - 1, 0)], crossover[min(i + 1, _CANDIDATES - 1)]
    return best if np.isfinite(best[0]) and band.linear.growth(*best[1:]) < 1 else (np.inf, np.nan, np.nan)


def _lags(band: _Band, kp: np.ndarray, ki: np.ndarray) -> np.ndarray:
    """Lag (deg, n) at the end of the band; inf where the estimate droops or the loop crosses 1 more than once."""
    rate, column = band.linear.rate, (kp[:, None], ki[:, None])
    above = np.abs(controller_response(*column, rate, band.curve) * band.over) > 1
    controller = controller_response(*column, rate, band.inside)
    tracked = controller * band.coil / (1 + controller * band.forward)
    lag = -np.degrees(np.unwrap(np.angle(tracked), axis=1)[:, -1])
    allowed = (np.abs(tracked).min(axis=1) >= band.least) & ((above[:, 1:] != above[:, :-1]).sum(axis=1) == 1)
    return np.where(allowed, lag, np.inf)


def _gains(forward: np.ndarray, crossover: ArrayLike, margin: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Gains whose sampled controller turns a forward response at the crossover (Hz) into a margin (deg)."""
    controller = -np.exp(1j * np.radians(margin)) / forward
    # 1 / (1 - e^-jx) = 1/2 - j/2 cot(x/2)
    ki = -2 * rate * np.tan(np.pi * np.asarray(crossover) / rate) * controller.imag
    return controller.real - ki / rate / 2, ki


def _curve(linear: LinearSensor, n: int) -> np.ndarray:
    return np.geomspace(1e-5 * linear.rate, 0.499 * linear.rate, n)


def _static(linear: LinearSensor) -> float:
    """Static ratio of estimated to true gap."""
    return float(np.abs(linear.coil(0.0) / linear.forward(0.0)))


def _at(f: np.ndarray, values: np.ndarray, where: float) -> float:
    return float(np.interp(np.log(where), np.log(f), values))


def _first_below(f: np.ndarray, values: np.ndarray, level: float) -> float:
    """Frequency at which values first fall below a level; infinite if they never do."""
    below = np.nonzero((values[1:] < level) & (values[:-1] >= level))[0]
    if below.size == 0:
        return np.inf
    i = below[0]
    share = (values[i] - level) / (values[i] - values[i + 1])
    return float(f[i] * (f[i + 1] / f[i]) ** share)
