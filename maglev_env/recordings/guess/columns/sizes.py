"""What the size of a motion says of its unit: what a magnet could hold, and how far it could shake a rotor."""

from collections.abc import Mapping, Sequence

import numpy as np

from maglev_env.recordings.formats.time_stamps import coarse_step
from maglev_env.recordings.guess.rate import stated_step, time_scale

_GRAVITY = 9.80665
MOST_SHAKEN = 500.0  # m/s2 rms: fifty times the weight, beyond what magnets do to a rotor


def step_of(time: np.ndarray | None, numbers: Mapping[str, float]) -> float:
    """Time between two samples, s; 0 where neither a column of time (samples,) nor a number of the file tells it."""
    if time is not None:
        coarse = coarse_step(time)
        return (coarse[0] if coarse else float(np.median(np.diff(time)))) * time_scale(time, numbers)[0]
    stated = stated_step(numbers)
    return stated[0] if stated else 0.0


def too_slow_for(lengths: Sequence[np.ndarray], step: float) -> bool:
    """Whether distances (samples,) could not be held at a sample every `step` s if they were in mm.

    What hangs at a distance x below a magnet falls with a time constant of about sqrt(x / g), which a controller must
    beat.
    """
    if not step > 0 or not all(v.min() > 0 and v.mean() > 2 * v.std() for v in lengths):
        return False
    return max(float(v.mean()) for v in lengths) * 1e-3 < _GRAVITY * step**2


def acceleration(values: np.ndarray, step: float) -> float:
    """About the rms acceleration of a motion (samples,), in its unit per s^2: rms times the square of the frequency
    below which half of its power lies; 0 where the clock is not known."""
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size))) ** 2
    if not step > 0 or not power.any():
        return 0.0
    below = np.cumsum(power)
    half = int(np.searchsorted(below, 0.5 * below[-1])) / (values.size * step)
    return float(values.std()) * (2 * np.pi * half) ** 2
