"""Lost commands that are seen one by one: in the current, which goes on toward the command before.

From one control sample to the next the current moves toward what the amplifier was sent. A delay or a lag moves it
toward a mixture of commands that is always the same; where a command was lost, it moves toward the last one that was
not. Both are fitted to all samples, and their likelihoods are compared.
"""

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.recorded.open_record import OpenRecord

SEEN = "lost commands"  # the family of this evidence
LEAST = 60.0  # twice the difference of log-likelihoods from which on commands were lost
FEWEST = 200  # samples
ROUNDS = 4  # of telling which were lost, and fitting again
CURRENT = "current"


def seen_lost(problem: Problem) -> float:
    """Twice the logarithm of the likelihood ratio of lost commands against any fixed lag, of all recordings without a
    period that hold command and current at the control rate; 0 where they show none."""
    total = 0.0
    for part in problem.parts:
        record = part.record
        if isinstance(record, OpenRecord) and record.every == 1 and CURRENT in record.series:
            found = sum(_likelier(i, u) for i, u in zip(record.series[CURRENT], record.command, strict=True))
            total += found if found > LEAST else 0.0
    return total


def _likelier(current: np.ndarray, command: np.ndarray) -> float:
    """The likelihood ratio of one axis: series (samples,), A."""
    after, before, n = current[2:], current[1:-1], current.size - 2
    if n < FEWEST or np.ptp(command) == 0 or np.ptp(current) == 0:
        return 0.0
    one = np.ones(n)
    fixed = np.column_stack([before, current[:-2], command[1:-1], command[:-2], one])
    coefficients, rest = _fitted(fixed, after)
    rate = float(np.clip(coefficients[0] + coefficients[1], 0.0, 0.999))
    slope = np.array([rate, 1 - rate, 0.0])
    for _ in range(ROUNDS):
        sent, lost = _sent(after - slope[0] * before - slope[2], slope[1] * command[1:-1], slope[1] * command[0])
        share = float(np.clip(lost.mean(), 1 / n, 1 - 1 / n))
        slope, left = _fitted(np.column_stack([before, sent / slope[1], one]), after)
        if slope[1] <= 0:
            return 0.0
    # Of the mixture, the more probable half of each sample alone counts: its likelihood is rather larger.
    choices = lost.sum() * np.log(share) + (n - lost.sum()) * np.log(1 - share)
    return float(n * np.log(rest / left) + 2 * choices)


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
