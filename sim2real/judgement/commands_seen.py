"""Lost commands that are seen one by one: in the current, which goes on toward the command before.

From one control sample to the next the current moves toward what the amplifier was sent. A delay, a lag or a limit
moves it toward something that always depends on the commands in the same way; where a command was lost, it moves toward
the last one that was not. Both are fitted to all samples, and their likelihoods are compared. Losses must also be
independent of one another: in a limit, a command that does not arrive is followed by others.
"""

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.recorded.open_record import OpenRecord

SEEN = "lost commands"  # the family of this evidence
LEAST = 60.0  # twice the difference of log-likelihoods from which on commands were lost
FEWEST = 200  # samples
ROUNDS = 4  # of telling which were lost, and fitting again
LATEST, LAGS = 24, 8  # samples by which a command may come late, and over which a lag may spread it
HINGES = (0.02, 0.1, 0.25, 0.75, 0.9, 0.98)  # quantiles of the command at which a limit may bend it
TELLING = 4.0  # standard deviations by which a command must differ from the last one to tell whether it was lost
EXACT = 1e-7  # of the current's range: what rounding leaves where the rival explains all
ALIKE = 0.15  # most difference of the shares that are lost after one that was lost and after one that was not
CURRENT = "current"


def seen_lost(problem: Problem) -> float:
    """Twice the logarithm of the likelihood ratio of lost commands against any lag or limit.

    It is that of all recordings without a period that hold command and current at the control rate; 0 where they show
    none.
    """
    total = 0.0
    for part in problem.parts:
        record = part.record
        if isinstance(record, OpenRecord) and record.every == 1 and CURRENT in record.series:
            pairs = zip(record.series[CURRENT], record.command, strict=True)
            found = sum(_likelier(i[record.first :], u[record.first :]) for i, u in pairs)
            total += found if found > LEAST else 0.0
    return total


def _likelier(current: np.ndarray, command: np.ndarray) -> float:
    """The likelihood ratio of one axis: series (samples,), A."""
    n = current.size - LATEST - LAGS - 2
    if n < FEWEST or np.ptp(command) == 0 or np.ptp(current) == 0:
        return 0.0
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
        return 0.0
    rate = float(np.clip(coefficients[0] + coefficients[1], 0.0, 0.999))
    slope = np.array([rate, 1 - rate, 0.0])
    for _ in range(ROUNDS):
        reached, lost = _sent(after - slope[0] * before - slope[2], slope[1] * sent, slope[1] * late(shift + 1)[0])
        share = float(np.clip(lost.mean(), 1 / n, 1 - 1 / n))
        slope, left = _fitted(np.column_stack([before, reached / slope[1], one]), after)
        if slope[1] <= 0:
            return 0.0
    if not _one_as_another(slope[1] * sent, reached, lost, TELLING * np.sqrt(left)):
        return 0.0
    # Of the mixture, the more probable half of each sample alone counts: its likelihood is rather larger.
    choices = lost.sum() * np.log(share) + (n - lost.sum()) * np.log(1 - share)
    return float(n * np.log(rest / left) + 2 * choices)


def _one_as_another(toward: np.ndarray, reached: np.ndarray, lost: np.ndarray, telling: float) -> bool:
    """Whether commands are lost independently of whether the one before was, judged where a loss can be told."""
    last = np.concatenate([toward[:1], reached[:-1]])
    told = abs(toward - last) > telling
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
