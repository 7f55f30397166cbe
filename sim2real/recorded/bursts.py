"""Bursts: what differs between the periods of a recording, and comes at single moments.

Noise scatters alike at all times, and what the drive modulates scatters alike at the same moment of each period. A
loose contact, a force that fails for milliseconds or a knock does neither. Over the lines its power is spread like that
of noise, so nothing else tells it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.ndimage import maximum_filter1d

from estimation.lines.periods import split_periods
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record

BLOCKS = 64  # of a period
SHORTEST = 8  # samples of a block at least
LEAST_PERIODS = 3
FALSE_ALARM = 1e-4  # probability that noise shows one burst in a recording
TIMES = 3.0  # power of a burst, as a multiple of what scatters otherwise
AGAIN = 2  # bursts, with a quiet block between them, from which on it is said
SHOWN = 4


@dataclass(frozen=True)
class Bursts:
    """Bursts of one recording.

    Attributes:
        record: Its name.
        times: When they come, s after the recording's first sample.
        power: The largest power, as a multiple of what scatters otherwise.
    """

    record: str
    times: tuple[float, ...]
    power: float

    def in_words(self) -> str:
        """A sentence on them."""
        at = ", ".join(f"{t:.3g}" for t in self.times[:SHOWN]) + (", .." if len(self.times) > SHOWN else "")
        return (
            f"{self.record}: the displacement differs from period to period in {len(self.times)} bursts (at {at} s; "
            f"up to {self.power:.2g} times the power of what scatters otherwise), which noise does not: "
            "look for what acts at moments, as a loose contact, a current that fails or a knock"
        )


def bursts(records: Sequence[Record | OpenRecord]) -> list[Bursts]:
    """The recordings with a period that show bursts.

    Args:
        records: All recordings.
    """
    return [found for r in records if isinstance(r, Record) and (found := _of(r)) is not None]


def _of(record: Record) -> Bursts | None:
    e = record.experiment
    samples = e.recorded_per_period
    length = max(samples // BLOCKS, SHORTEST)
    if record.count < LEAST_PERIODS or samples < 2 * length:
        return None
    periods = split_periods(record.series["displacement"], samples)  # (P, axes, samples)
    apart = periods - np.median(periods, axis=0)
    kept = samples // length * length
    power = np.square(apart[..., :kept]).reshape(*apart.shape[:2], -1, length).mean(axis=-1)  # (P, axes, blocks)
    # What drifts differs more in some periods than in others, and is no burst; nor are single steps of a converter.
    usual = np.maximum(np.median(power, axis=2, keepdims=True), record.nominal.reading_step**2)
    if not usual.all():  # without noise, nothing tells what is usual
        return None
    power = (power / usual).mean(axis=1)
    others = (power.sum(axis=0) - power) / (len(power) - 1)  # at the same moment of the other periods
    beside = maximum_filter1d(np.maximum(others, 1.0), 3, axis=1, mode="wrap")
    noise = stats.chi2(_freedom(apart, length))
    loud = (power / beside > max(float(noise.isf(FALSE_ALARM / power.size) / noise.median()), TIMES)).reshape(-1)
    begins = np.flatnonzero(loud & ~np.roll(loud, 1))
    if len(begins) < AGAIN:
        return None
    period, block = np.divmod(begins, power.shape[1])
    times = record.start + (period * samples + block * length) / e.recorded_rate
    return Bursts(record.name, tuple(times.tolist()), float(power.max()))


def _freedom(apart: np.ndarray, length: int) -> float:
    """Degrees of freedom of the power of a block: fewer than its samples, as noise in a closed loop is coloured."""
    spectrum = np.square(np.abs(np.fft.rfft(apart, axis=-1))).mean(axis=(0, 1))
    correlation = np.fft.irfft(spectrum, apart.shape[-1])[:length]
    correlation = correlation / correlation[0]
    weight = 1 - np.arange(length) / length
    return max(length * apart.shape[1] / float(2 * np.sum(weight * correlation**2) - 1), 1.0)
