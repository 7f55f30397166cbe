"""Lowest stable sampling rate of a parameter estimator over its PI gains (D 7.2, point 6).

Stable means that a small error around the converged orbit decays from cycle to cycle, at a constant gap and half duty.
In simulation, a start at the other end of the gap's range then settles too, with 0.95 of the gains at the limit; with
1.05 of them the estimate runs from end to end of its range. The limit therefore holds not only for small errors.

Stable does not mean useful. Near the limit the estimate rings and amplifies some frequencies many times. Where rate and
PWM frequency have no whole ratio, edges lie within samples and the estimate ripples: 0.3 µm at 165 kHz and 57 µm at
55 kHz.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from selfsense.linear import LinearSensor, linearise, strongest_drive
from selfsense.sensor import SelfSensor
from selfsense.supply import Supply

_PARTS = 5  # rates lie in steps of the PWM frequency divided by this, which keeps a cycle short
_SCAN = 120  # gains tried along a ray before its limit is refined


def sampling_rates(supply: Supply, highest: float) -> np.ndarray:
    """Rates (Hz) from twice the PWM frequency up to `highest`, in steps of a fifth of it: 5 kHz at 25 kHz."""
    step = supply.frequency / _PARTS
    return step * np.arange(2 * _PARTS, int(np.floor(highest / step * (1 + 1e-12))) + 1)


def lowest_stable_rate(sensor: SelfSensor, kp: ArrayLike, ki: ArrayLike, rates: ArrayLike | None = None) -> np.ndarray:
    """Lowest sampling rate (Hz), (n, m), from which on every higher rate is stable, as a search from above finds it.

    Some rates below it may be stable again.

    Args:
        sensor: The sensor.
        kp: (n,), m/A.
        ki: (m,), m/(A s).
        rates: Rates (k,), Hz; by default those of `sampling_rates` up to the sensor's own. A rate at which the forward
            path or the simulated current does not exist ends the search.

    Returns:
        Rates (n, m); nan where the highest rate is not stable.

    Raises:
        ValueError: No rate is possible.
    """
    rates = sampling_rates(sensor.supply, sensor.acquisition.rate) if rates is None else np.asarray(rates, dtype=float)
    if rates.size == 0:
        raise ValueError("rates: give at least one sampling rate, of twice the PWM frequency or more")
    kp, ki = np.asarray(kp, dtype=float)[:, None], np.asarray(ki, dtype=float)[None, :]
    lowest = np.full((kp.size, ki.size), np.nan)
    holds = np.ones(lowest.shape, bool)
    for count, rate in enumerate(np.sort(rates)[::-1]):
        try:
            linear = _at_rate(sensor, float(rate))
        except ValueError:
            if count == 0:
                raise
            break
        holds[holds] = linear.growth(*[a[holds] for a in np.broadcast_arrays(kp, ki)]) < 1
        lowest[holds] = rate
    return lowest


def gains_with_limit(sensor: SelfSensor, rate: float, corner: ArrayLike | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Gains kp (m/A) and ki (m/(A s)), (n,), up to which the estimator is stable at a sampling rate (Hz).

    Gains for which one rate is stable and the next lower one is not lie between the curves of the two. D's gains are
    stable at 165 kHz and not at 160; at 250 kHz they leave 3 to 9 degrees of phase margin, far below the 83 that D
    gives.

    Args:
        sensor: The sensor.
        rate: Hz.
        corner: ki / (2 pi kp), (n,), Hz, above which the controller is mostly proportional; by default 30 Hz to 10 kHz.

    Returns:
        kp and ki; nan where none or all of the gains tried are unstable.

    Raises:
        ValueError: The estimator cannot be sampled at this rate.
    """
    corner = np.geomspace(30.0, 10e3, 25) if corner is None else np.asarray(corner, dtype=float)
    linear = _at_rate(sensor, rate)
    ratio = 2 * np.pi * corner
    # Gains along a ray, in units of the gain at which the static loop gain would be one.
    scale = 1 / np.abs(linear.forward(0.0))
    scan = scale * np.geomspace(1e-2, 30.0, _SCAN)[:, None]
    unstable = linear.growth(scan, scan * ratio) >= 1
    first = unstable.argmax(axis=0)
    high, low = scan[first, 0], scan[np.maximum(first - 1, 0), 0]
    for _ in range(30):
        middle = (low + high) / 2
        holds = linear.growth(middle, middle * ratio) < 1
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    kp = np.where(unstable.any(axis=0) & (first > 0), low, np.nan)
    return kp, kp * ratio


def _at_rate(sensor: SelfSensor, rate: float) -> LinearSensor:
    changed = replace(sensor, acquisition=replace(sensor.acquisition, rate=rate))
    return linearise(changed, strongest_drive(sensor.supply))
