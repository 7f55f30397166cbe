"""Lost commands that are seen one by one: in the current, which goes on toward the command before.

From one control sample to the next the current moves toward what the amplifier was sent. A delay, a lag or a limit
moves it toward something that always depends on the commands in the same way; where a command was lost, it moves toward
the last one that was not. Both are fitted to all samples, and their likelihoods are compared. Losses must also be
independent of one another: in a limit, a command that does not arrive is followed by others.

How many are lost is counted where the command differs enough from the one before. On average a loop that loses commands
is one that comes late, so that a simulation alone would make up for a delay by more of them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv, ndtr

from sim2real.compared.problem import Problem
from sim2real.recorded.open_record import OpenRecord

SEEN, LOST = "lost commands", "dropped_samples"  # the family of this evidence, and the effect that it is of
LEAST = 60.0  # twice the difference of log-likelihoods from which on commands were lost
FEWEST = 200  # samples
ROUNDS = 4  # of telling which were lost, and fitting again
LATEST, LAGS = 24, 8  # samples by which a command may come late, and over which a lag may spread it
HINGES = (0.02, 0.1, 0.25, 0.75, 0.9, 0.98)  # quantiles of the command at which a limit may bend it
TELLING = 4.0  # standard deviations by which a command must differ from the last one to tell whether it was lost
COUNTED = 10.0  # and by which it must where losses are counted: one in forty would be taken for one of TELLING
EXACT = 1e-7  # of the current's range: what rounding leaves where the rival explains all
ALIKE = 0.15  # most difference of the shares that are lost after one that was lost and after one that was not
CURRENT = "current"
# Standard deviations, of a normal distribution, whose tails lie beyond the probabilities that are sought; and what a
# count is unsure by beside chance: of four recordings it was off by 3 % at most.
WITHIN, UNSURE = 2.5, 0.05


@dataclass(frozen=True)
class _Looked:
    """What the current of one axis shows.

    Attributes:
        likelier: Twice the logarithm of the likelihood ratio of lost commands; 0 where there are none.
        lost: Commands that were lost among those that are told.
        told: Samples at which a loss is told beyond doubt.
    """

    likelier: float = 0.0
    lost: int = 0
    told: int = 0


def share_lost(problem: Problem) -> tuple[float, float] | None:
    """Least and greatest probability of a loss by what was counted; None where the recordings show none.

    The ends are those under which as many or more, and as few or fewer, would be rare (Clopper and Pearson 1934).
    """
    looked = [own for record in _able(problem) for own in record if own.likelier > LEAST]
    told = sum(own.told for own in looked)
    if told < FEWEST:
        return None
    lost = sum(own.lost for own in looked)
    share, rare = lost / told, ndtr(-WITHIN)
    low = betaincinv(lost, told - lost + 1, rare) if lost else 0.0
    high = betaincinv(lost + 1, told - lost, 1 - rare) if lost < told else 1.0
    below, above = (float(np.hypot(by, WITHIN * UNSURE * share)) for by in (share - low, high - share))
    return max(share - below, 0.0), min(share + above, 1.0)


def seen_lost(problem: Problem) -> float:
    """Twice the logarithm of the likelihood ratio of lost commands against any lag or limit.

    It is that of all recordings without a period that hold command and current at the control rate; 0 where they show
    none.
    """
    totals = (sum(own.likelier for own in record) for record in _able(problem))
    return sum(total for total in totals if total > LEAST)


def _able(problem: Problem) -> Iterator[list[_Looked]]:
    """What each recording shows that holds command and current at the control rate, axis by axis."""
    for part in problem.parts:
        record = part.record
        if isinstance(record, OpenRecord) and record.every == 1 and CURRENT in record.series:
            pairs = zip(record.series[CURRENT], record.command, strict=True)
            yield [_looked(i[record.first :], u[record.first :]) for i, u in pairs]


def _looked(current: np.ndarray, command: np.ndarray) -> _Looked:
    """What one axis shows: series (samples,), A."""
    n = current.size - LATEST - LAGS - 2
    if n < FEWEST or np.ptp(command) == 0 or np.ptp(current) == 0:
        return _Looked()
    after, before, one = current[-n:], current[-n - 1 : -1], np.ones(n)
    own = [before, current[-n - 2 : -2], one]

    def late(samples: int) -> np.ndarray:
        return command[-n - 1 - samples : -1 - samples]

    # The rival: a command that comes late, is spread, and may be bent by a limit.
    shift = min(range(LATEST), key=lambda s: _fitted(np.column_stack([*own, late(s), late(s + 1)]), after)[1])
    sent = late(shift)
    bent = [np.maximum(sent - edge, 0.0) for edge in np.quantile(sent, HINGES)]
    spread = [late(shift + k) for k in range(LAGS)]
    coefficients, rest = _fitted(np.column_stack([*own, *spread, *bent]), after)
    if rest < (EXACT * np.ptp(current)) ** 2:
        return _Looked()
    rate = float(np.clip(coefficients[0] + coefficients[1], 0.0, 0.999))
    slope = np.array([rate, 1 - rate, 0.0])
    for _ in range(ROUNDS):
        reached, lost = _sent(after - slope[0] * before - slope[2], slope[1] * sent, slope[1] * late(shift + 1)[0])
        share = float(np.clip(lost.mean(), 1 / n, 1 - 1 / n))
        slope, left = _fitted(np.column_stack([before, reached / slope[1], one]), after)
        if slope[1] <= 0:
            return _Looked()
    toward = slope[1] * sent
    differs = abs(toward - np.concatenate([toward[:1], reached[:-1]])) / np.sqrt(left)
    if not _one_as_another(lost, differs > TELLING):
        return _Looked()
    surely = differs > COUNTED
    # Of the mixture, the more probable half of each sample alone counts: its likelihood is rather larger.
    choices = lost.sum() * np.log(share) + (n - lost.sum()) * np.log(1 - share)
    return _Looked(float(n * np.log(rest / left) + 2 * choices), int(lost[surely].sum()), int(surely.sum()))


def _one_as_another(lost: np.ndarray, told: np.ndarray) -> bool:
    """Whether commands are lost independently of whether the one before was, judged where a loss can be told."""
    both = told[1:] & told[:-1]
    before, now = lost[:-1][both], lost[1:][both]
    if not before.any() or before.all():
        return bool(before.size) and not before.all()
    return abs(float(now[before].mean()) - float(now[~before].mean())) < ALIKE + 3.0 / np.sqrt(before.sum())


def _fitted(columns: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients of least squares, and the mean square that they leave."""
    found = np.linalg.lstsq(columns, values, rcond=None)[0]
    return found, max(float(np.mean((values - columns @ found) ** 2)), 1e-300)


def _sent(moved: np.ndarray, toward: np.ndarray, first: float) -> tuple[np.ndarray, np.ndarray]:
    """What the amplifier was sent at each sample, and whether that is the command before.

    Args:
        moved: by how much the current moved toward what was sent, in units of `toward` (samples,).
        toward: the command (samples,).
        first: what was sent before the first sample.
    """
    sent, lost, last = np.empty_like(toward), np.zeros(toward.size, bool), first
    for k, (m, u) in enumerate(zip(moved.tolist(), toward.tolist(), strict=True)):
        lost[k] = abs(m - last) < abs(m - u)
        last = last if lost[k] else u
        sent[k] = last
    return sent, lost
