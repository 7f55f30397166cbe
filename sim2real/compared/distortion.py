"""Where a nonlinear loop answers to a few sines that drive it: at their harmonics, and at sums and differences.

A record that one or a few sines drive has lines there which no smooth response to the drive explains. They are what a
saturation or a friction makes, and no tone of another origin.
"""

from itertools import product

import numpy as np
from scipy.signal.windows import hann

from sim2real.recorded.open_record import OpenRecord

SINES, OF_POWER = 4, 0.98  # most sines, and the least share of what drives a record that they must have
LOBE = 3  # lines to either side that a sine takes up under a Hann window
ORDER = (15, 7, 5, 3)  # highest order that is looked at, of one sine, of two ...
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


def distorted(record: OpenRecord, frequency: np.ndarray, order: int | None = None) -> np.ndarray:
    """Whether frequencies (n,), Hz, lie where a nonlinear loop answers to the sines that drive a record.

    Args:
        record: the record.
        frequency: of possible tones.
        order: highest one of the products of the sines; by default one that leaves most frequencies free.
    """
    sines, width = driving_sines(record), record.windows.sample_rate / record.windows.samples
    near = np.zeros(frequency.size, bool)
    if not sines.size:
        return near
    most = ORDER[sines.size - 1] if order is None else min(order, ORDER[sines.size - 1])
    for times in product(range(-most, most + 1), repeat=sines.size):
        if 0 < np.sum(np.abs(times)) <= most and (at := float(np.dot(times, sines))) > 0:
            near |= abs(frequency - at) < LOBE * width
    return near
