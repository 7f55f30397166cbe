"""Channels that stand in for missing ones: an acceleration for the displacement, a coil's voltage for its current."""

from collections.abc import Mapping

import numpy as np
import scipy

SLOWEST = 4.0  # periods in a record: slower motion than this cannot be told from the drift of an accelerometer
START = 5.0  # time constants of a coil whose voltage tells what flowed at the start


def displacements(channels: Mapping[str, np.ndarray], rate: float) -> tuple[dict[str, np.ndarray], list[str]]:
    """Displacements that follow from accelerations where none is recorded, and what was assumed.

    Args:
        channels: name -> (samples,), SI.
        rate: Hz.
    """
    found, notes = {}, []
    for name, values in channels.items():
        kind, mark, axis = name.partition("_")
        displacement = f"displacement{mark}{axis}"
        if kind == "acceleration" and displacement not in channels:
            found[displacement] = integrated_twice(values, rate)
            notes.append(
                f"{displacement} is the acceleration integrated twice, from {SLOWEST * rate / values.size:.3g} Hz on"
            )
    return found, notes


def integrated_twice(acceleration: np.ndarray, rate: float) -> np.ndarray:
    """Displacement (samples,) of an acceleration (m/s2), without what is slower than SLOWEST periods in the record."""
    n = acceleration.size
    spectrum = np.asarray(scipy.fft.rfft(acceleration - acceleration.mean()))
    line = np.arange(spectrum.size)
    omega = 2 * np.pi * line * rate / n
    kept = line >= SLOWEST
    spectrum[kept] /= -(omega[kept] ** 2)
    spectrum[~kept] = 0.0
    return np.asarray(scipy.fft.irfft(spectrum, n))


def coil_current(voltage: np.ndarray, rate: float, resistance: float, inductance: float) -> np.ndarray:
    """Current (samples,) of a coil under a voltage held between samples.

    What flowed at the start is not known. The median of the voltage over the time constants that follow is taken to
    have held it: the first sample alone may be the kick of a step.
    """
    decay = np.exp(-resistance / inductance / rate)
    steady = voltage / resistance
    first = np.median(steady[: max(1, round(START * inductance / resistance * rate))])
    before = np.concatenate([[first], steady[:-1]])
    return scipy.signal.lfilter([1 - decay], [1.0, -decay], before, zi=[decay * first])[0]
