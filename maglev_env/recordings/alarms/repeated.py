"""Samples that were stored twice."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_env.recordings.alarms.alarm import READINGS, STUCK_SAMPLES, Alarm
from maglev_env.recordings.masking import MOST_MASKED, runs

if TYPE_CHECKING:
    import xarray as xr

MOVES = 2.5  # converter steps between two readings in the middle of a motion
MOST_EXPLAINED = 0.2  # share of samples that repeat by the resolution of the displacement


def repeated_samples(dataset: "xr.Dataset", start: int = 0) -> list[Alarm]:
    """All channels repeat at once more often than their resolution explains: samples that were stored twice.

    Nothing is said of a resampled recording: its time stamps tell of double samples, and between two equal readings
    interpolation repeats a value that no converter step explains.
    """
    if "row" in dataset.coords:
        return []
    rate = dataset.attrs["sample_rate"]
    moving = [n for n in dataset.data_vars if n.partition("_")[0] in READINGS and np.ptp(dataset[n].values) > 0]
    if len(moving) < 2:
        return []
    # The controller sees the displacement alone: where that repeats, command and current do so, too, and no coincidence
    # of channels tells a double sample from a coarse reading.
    sensed = {n: _explained(dataset[n].values) for n in moving if not n.startswith("command")}
    steady = max((p for n, p in sensed.items() if n.startswith("displacement")), default=0.0)
    if not sensed or steady > MOST_EXPLAINED:
        return []
    values = [dataset[n].values for n in moving]
    equal = np.all([np.diff(v) == 0 for v in values], axis=0)
    if max((b - a for a, b in runs(equal)), default=0) >= STUCK_SAMPLES:
        return []
    # Where all turn round at once, as in each period of a slow sine, coarse readings repeat; one that is stored twice
    # stands in the middle of a motion.
    equal &= np.any([_in_motion(dataset[n].values) for n in sensed], axis=0)
    count, size = int(equal.sum()), equal.size
    # Two steady readings in a row give two equal commands, and a coarse current with them.
    explained = max(10 * float(np.prod([*sensed.values()])), 2 * steady**2) * size
    if count <= 5 + explained:
        return []
    first = int(np.argmax(equal)) + 1
    severity = "refuse" if count > MOST_MASKED * size else "warning"
    text = (
        f"{count} samples repeat the one before in every channel ({count / size:.2%}), the first at "
        f"{first / rate:.4g} s (sample {start + first}): they were stored twice, and the time axis is stretched there"
    )
    return [Alarm("samples", "all channels", first / rate, text, severity)]


def _explained(values: np.ndarray) -> float:
    """Share of samples that repeat by resolution alone: the step of the readings over the spread of their changes."""
    return min(1.0, _step(values) / (2.5 * max(float(np.median(np.abs(np.diff(values)))) / 0.67, 1e-300)))


def _step(values: np.ndarray) -> float:
    """Smallest change of readings."""
    steps = np.abs(np.diff(values))
    return float(steps[steps > 1e-6 * steps.max()].min())  # steps below are rounding of the same converter step


def _in_motion(values: np.ndarray) -> np.ndarray:
    """Whether a reading moves on by several steps both before and after each of its changes, (samples - 1,) bool."""
    fast = np.pad(np.abs(np.diff(values)) > MOVES * _step(values), 1)
    return fast[:-2] & fast[2:]
