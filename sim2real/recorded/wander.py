"""What changes slowly over the periods of a recording: straight lines over time, a level that wanders, and excited
lines that grow or fade."""

from collections.abc import Mapping

import numpy as np
import scipy.fft
from scipy import stats

from estimation.lines.periods import from_middle, straightened

LEAST = 3  # periods below which a trend cannot be told from noise
LOWEST = 10  # lines of a period whose scatter is taken for that of its mean
SURELY = 1e-5  # probability that noise alone makes a level seem to wander, or lines to fade
# Power of the slope of an excited line in that of another line: a transient has a slope on every line, a gain that
# drifts hardly where nothing is excited.
ON_EXCITED = 10.0


def without_wander(values: np.ndarray, per_period: int) -> np.ndarray:
    """Whole periods (axes, samples) without the straight line of a level that surely wanders.

    A ramp leaks into all lines of a period, most into the lowest. Its slope is that of the means of the periods, which
    the periodic part does not have. Values whose level stays are returned as they are.
    """
    count = values.shape[1] // per_period
    if count < LEAST:
        return values
    periods = values.reshape(len(values), count, per_period)
    lines = scipy.fft.rfft(periods, axis=2)[..., : LOWEST + 1].swapaxes(0, 1) / per_period
    slope, rest = straightened(lines)
    at, freedom = from_middle(count), 2 * LOWEST * (count - 2)
    # Noise has at zero, where it is real, the power of that of a line, which is complex.
    sd = np.sqrt((abs(rest[..., 1:]) ** 2).sum(axis=(0, 2)) / (LOWEST * (count - 2)) / (at @ at))
    level = slope[:, 0].real
    wanders = abs(level) > stats.t.isf(SURELY / 2, freedom) * sd
    if not wanders.any():
        return values
    time = (np.arange(values.shape[1]) - (values.shape[1] - 1) / 2) / per_period
    return values - np.where(wanders, level, 0.0)[:, None] * time


def without_leak(
    channels: Mapping[str, np.ndarray], lines: np.ndarray, excited: np.ndarray, per_period: int
) -> Mapping[str, np.ndarray]:
    """Amplitudes without what excited lines that grow or fade leave on others.

    The transform of a period takes its lines for steady. One that grows in the period leaks into its neighbours, by its
    growth in a period over 2 pi and their distance in lines, in all periods alike: the mean over the periods holds it,
    and the noise that their scatter tells does not. The growth of each excited line is that over the periods. Where it
    is not surely there in any channel, or is no more than that of other lines, the amplitudes are returned as they are.

    Args:
        channels: name -> (P, axes, n), amplitudes of each period.
        lines: (n,), harmonic numbers.
        excited: (n,), whether a line is excited.
        per_period: samples in a period.
    """
    count = len(next(iter(channels.values())))
    if count < LEAST or not any(_fade(periods, excited) for periods in channels.values()):
        return channels
    # Of x(t) = Re(s (t - 1/2) exp(j k t)) in a period, the amplitude of line n is s I(k - n) + conj(s) I(-k - n).
    own = lines[excited][:, None]
    along, against = _ramp(own - lines, per_period), _ramp(-own - lines, per_period)
    grown = {name: straightened(periods)[0][:, excited] for name, periods in channels.items()}
    # All of them: what one channel leaks into another belongs to what it is compared with there.
    return {name: periods - grown[name] @ along - grown[name].conj() @ against for name, periods in channels.items()}


def _fade(periods: np.ndarray, excited: np.ndarray) -> bool:
    """Whether the excited lines (n,) of one channel (P, axes, n) surely grow or fade, and others do not."""
    slope, rest = straightened(periods)
    at, freedom = from_middle(len(periods)), len(periods) - 2
    power = abs(slope) ** 2
    noise = (abs(rest) ** 2).sum(axis=0).mean(axis=-1) / freedom / (at @ at)
    by_chance = stats.f.isf(SURELY, 2 * int(excited.sum()), 2 * excited.size * freedom) * noise
    beside = power[:, ~excited].mean(axis=-1) if not excited.all() else np.zeros(len(power))
    return bool((power[:, excited].mean(axis=-1) > np.maximum(by_chance, ON_EXCITED * beside)).any())


def _ramp(apart: np.ndarray, samples: int) -> np.ndarray:
    """Mean of (t - mean t) exp(j 2 pi m t) over the samples of 0 <= t < 1, of integers m; 0 where m is 0."""
    turned = np.expm1(2j * np.pi * apart / samples)
    return np.divide(1.0, samples * turned, out=np.zeros(apart.shape, complex), where=apart % samples != 0)
