"""Where a nonlinear loop answers to what drives it: at harmonics, sums and differences of a few sines, or at multiples
of the rate at which a pattern repeats.

A record that a few sines drive, or set-point steps in turn, has lines there which no smooth response to the drive
explains. They are what a saturation, a friction or a bent force law makes, and no tone of another origin.
"""

from itertools import product

import numpy as np
from scipy.signal.windows import hann

from sim2real.recorded.open_record import OpenRecord

SINES, OF_POWER = 4, 0.98  # most sines, and the least share of what drives a record that they must have
LOBE = 3  # lines to either side that a sine takes up under a Hann window
ORDER = (15, 7, 5, 3)  # highest order that is looked at, of one sine, of two ...
REPEATED = 0.02  # share of a drive's power by which its repetitions may differ, the noise of a log included
NEAR = 0.3  # lines from a multiple of the rate of a pattern
COMMON = 3  # highest order that is likelier than a tone of known origin at the same place


def driving_sines(record: OpenRecord) -> np.ndarray:
    """Frequencies (n,), Hz, of the sines that drive a record; none where something else drives it, or nothing."""
    part = slice(record.first, record.first + record.windows.samples)
    waves = np.concatenate(list(record.waves.values()))[:, :: record.every][:, part]
    moved = waves - waves.mean(axis=1, keepdims=True)
    moved = moved[np.ptp(waves, axis=1) > 0]
    found: list[float] = []
    for wave in moved:
        power = abs(np.fft.rfft(wave * hann(wave.size, sym=False))) ** 2
        left, least = power.copy(), (1 - OF_POWER) * power.sum()
        own: list[float] = []
        while left.sum() > least and len(own) < SINES:
            peak = int(np.argmax(left))
            lobe = slice(max(peak - LOBE, 0), peak + LOBE + 1)
            own.append(float(np.average(np.arange(left.size)[lobe], weights=power[lobe])))
            left[lobe] = 0.0
        if left.sum() > least:
            return np.empty(0)
        found += [f for f in own if all(abs(f - g) > LOBE for g in found)]
    width = record.windows.sample_rate / record.windows.samples
    return np.array(found[:SINES] if len(found) <= SINES else []) * width


def pattern_rate(record: OpenRecord) -> float | None:
    """Rate (Hz) at which a pattern that drives a record repeats, at least twice in it; None where none does."""
    part = slice(record.first, record.first + record.windows.samples)
    waves = np.concatenate(list(record.waves.values()))[:, :: record.every][:, part]
    moved = waves[np.ptp(waves, axis=1) > 0]
    if not len(moved):
        return None
    moved = moved - moved.mean(axis=1, keepdims=True)
    moved /= moved.std(axis=1, keepdims=True)
    count = moved.shape[1]
    products = np.fft.irfft((abs(np.fft.rfft(moved, 2 * count)) ** 2).sum(axis=0), 2 * count)[: count // 2]
    before = np.cumsum((moved**2).sum(axis=0))
    lags = np.arange(count // 2)
    # Power of the difference between the record and itself later, over that of both.
    power = before[count - 1 - lags] + before[-1] - np.where(lags > 0, before[lags - 1], 0.0)
    apart = 1 - 2 * products / power
    left = int(np.argmax(apart > 0.5))  # the shortest lags look alike anyway
    alike = np.flatnonzero((apart < REPEATED) & (lags > left)) if left else np.empty(0, int)
    if not alike.size:
        return None
    first = alike[alike < alike[0] * 1.1 + 2]
    return record.windows.sample_rate / float(first[np.argmin(apart[first])])


def distorted(record: OpenRecord, frequency: np.ndarray, order: int | None = None) -> np.ndarray:
    """Whether frequencies (n,), Hz, lie where a nonlinear loop answers to the sines or the pattern that drive a record.

    Args:
        record: the record.
        frequency: of possible tones.
        order: highest one of the products of the sines; by default one that leaves most frequencies free.
    """
    sines, width = driving_sines(record), record.windows.sample_rate / record.windows.samples
    near = np.zeros(frequency.size, bool)
    if not sines.size:
        rate = pattern_rate(record)
        if rate is None:
            return near
        multiple = np.round(frequency / rate)
        close = abs(frequency - multiple * rate) < NEAR * width
        return close & (multiple >= 1) & (multiple <= min(order or ORDER[0], ORDER[0]))
    most = ORDER[sines.size - 1] if order is None else min(order, ORDER[sines.size - 1])
    for times in product(range(-most, most + 1), repeat=sines.size):
        if 0 < np.sum(np.abs(times)) <= most and (at := float(np.dot(times, sines))) > 0:
            near |= abs(frequency - at) < LOBE * width
    return near
