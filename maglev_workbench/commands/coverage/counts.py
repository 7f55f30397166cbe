"""Counts of intervals: how often they hold what they are said to hold."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from estimation.normal import NORMAL_95


@dataclass(frozen=True)
class Interval:
    """A 95 % interval of one draw, in SI.

    Args:
        low, high: its ends; infinite where it is open.
        truth: what it is said to hold.
        error: distance of the estimate from the truth in standard errors; nan where the interval is open.
    """

    low: float
    high: float
    truth: float
    error: float

    @property
    def holds(self) -> bool:
        return bool(self.low <= self.truth <= self.high)


def interval(low: float | None, high: float | None, truth: float) -> Interval:
    """An interval from its ends; None or an infinite one is open."""
    low, high = (end if end is not None else sign * np.inf for end, sign in ((low, -1), (high, 1)))
    half = (high - low) / 2
    closed = 0 < half < np.inf
    return Interval(low, high, truth, NORMAL_95 * (low + half - truth) / half if closed else np.nan)


@dataclass(frozen=True)
class Coverage:
    """How often the intervals of one quantity hold the truth.

    Attributes:
        quantity: its name; a band's has its middle in Hz.
        held: intervals that hold the truth.
        draws: draws that gave an interval.
        abstained: draws that gave none: "not bounded", or a recording of which nothing could be told.
        truth: mean over the draws that gave an interval, in SI; None where none did.
        half_width: median half width of the intervals, of the truth's size; None where half of them have no end.
        bias: mean distance of the estimate from the truth in standard errors; None where fewer than two are closed.
        spread: standard deviation of that distance; 1 where the standard errors are right; None likewise.
    """

    quantity: str
    held: int
    draws: int
    abstained: int
    truth: float | None
    half_width: float | None
    bias: float | None
    spread: float | None

    @property
    def covered(self) -> float | None:
        """Share of the intervals that hold the truth; None where there is none."""
        return self.held / self.draws if self.draws else None

    @property
    def interval(self) -> tuple[float, float] | None:
        """95 % interval of that share (Wilson)."""
        if not self.draws:
            return None
        found = scipy.stats.binomtest(self.held, self.draws).proportion_ci(method="wilson")
        return float(found.low), float(found.high)


def counted(quantity: str, found: Sequence[Interval | None]) -> Coverage:
    """Count the intervals of one quantity; None is a draw that gave none."""
    given = [one for one in found if one is not None]
    half = float(np.median([one.high - one.low for one in given]) / 2) if given else np.nan
    truth = float(np.mean([one.truth for one in given])) if given else None
    errors = np.array([one.error for one in given if np.isfinite(one.error)])
    several = errors.size > 1
    return Coverage(
        quantity,
        sum(one.holds for one in given),
        len(given),
        len(found) - len(given),
        truth,
        half / abs(truth) if truth and np.isfinite(half) else None,
        float(errors.mean()) if several else None,
        float(errors.std(ddof=1)) if several else None,
    )
