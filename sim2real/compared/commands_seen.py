"""Lost commands that are seen one by one: in the current, which goes on toward the command before.

From one control sample to the next the current moves toward what the amplifier was sent. A delay, a lag or a limit
moves it toward something that always depends on the commands in the same way; where a command was lost, it moves toward
the last one that was not. Both are fitted to all samples, and their likelihoods are compared. Losses must also be
independent of one another: in a limit, a command that does not arrive is followed by others.

How many are lost is counted where the command differs enough from the one before. On average a loop that loses commands
is one that comes late, so that a simulation alone would make up for a delay by more of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import betaincinv, ndtr

from sim2real.compared.problem import Part, Problem
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record

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
STALLS = "does the controller stall?"  # ends what is said of commands that are lost in turn
CURRENT, COMMAND = "current", "command"
# Standard deviations, of a normal distribution, whose tails lie beyond the probabilities that are sought; and what a
# count is unsure by beside chance: of four recordings it was off by 3 % at most.
WITHIN, UNSURE = 2.5, 0.05
REPEATED = 0.05  # share of commands that repeat the one before, from which on the log may be of what was sent
# Runs of lost commands that are said, losses that are told in one, and by how much of themselves their distances differ
# from whole multiples of the middle one in the USUAL share where they return regularly.
RUNS, IN_TURN, REGULAR, USUAL = 5, 4, 0.1, 0.75


def stalled(notes: Sequence[str]) -> bool:
    """Whether notes say that several commands in turn are lost."""
    return any(note.endswith(STALLS) for note in notes)


@dataclass(frozen=True)
class _Looked:
    """What the current of one axis shows.

    Attributes:
        likelier: Twice the logarithm of the likelihood ratio of lost commands; 0 where there are none.
        lost: Commands that were lost among those that are told.
        told: Samples at which a loss is told beyond doubt.
        runs: Where the lost ones follow one another, how many in turn, and samples from one run to the next (0: these
            differ); None where they do not.
    """

    likelier: float = 0.0
    lost: int = 0
    told: int = 0
    runs: tuple[int, int] | None = None


Commands = Sequence[Sequence[_Looked]]  # what each recording shows, axis by axis


def share_lost(problem: Problem) -> tuple[float, float] | None:
    """Least and greatest probability of a loss by what was counted; None where the recordings show none.

    The ends are those under which as many or more, and as few or fewer, would be rare (Clopper and Pearson 1934).
    """
    looked = [own for record in looked_at(problem) for own in record if own.likelier > LEAST]
    told = sum(own.told for own in looked)
    if told < FEWEST:
        return None
    lost = sum(own.lost for own in looked)
    share, rare = lost / told, ndtr(-WITHIN)
    low = betaincinv(lost, told - lost + 1, rare) if lost else 0.0
    high = betaincinv(lost + 1, told - lost, 1 - rare) if lost < told else 1.0
    below, above = (float(np.hypot(by, WITHIN * UNSURE * share)) for by in (share - low, high - share))
    return max(share - below, 0.0), min(share + above, 1.0)


def by_count(low: float, high: float) -> tuple[float, float]:
    """Probability of a loss and its standard error, by the ends that `share_lost` gives."""
    return (low + high) / 2, (high - low) / (2 * WITHIN)


def seen_lost(commands: Commands) -> float:
    """Twice the logarithm of the likelihood ratio of lost commands against any lag or limit; 0 where none are lost."""
    totals = (sum(own.likelier for own in record) for record in commands)
    return sum(total for total in totals if total > LEAST)


def none_lost(commands: Commands) -> bool:
    """Whether recordings tell a loss of single commands one by one, and none shows it."""
    looked = [own for record in commands for own in record]
    return sum(own.told for own in looked) >= FEWEST and all(own.likelier <= LEAST for own in looked)


def runs_in_words(problem: Problem, commands: Commands) -> list[str]:
    """Notes on commands that were lost several in turn, as where a controller stalls."""
    said = []
    for part, record in zip(_recording(problem), commands, strict=True):
        for length, apart in [own.runs for own in record if own.runs is not None]:
            rate = part.record.nominal.control_rate
            every = f", every {1e3 * apart / rate:.3g} ms" if apart else ""
            said.append(
                f"{part.record.name}: the amplifier goes on with the last command for up to {length} control samples "
                f"({1e3 * length / rate:.2g} ms) at a time{every}: {STALLS}"
            )
    return said


def _recording(problem: Problem) -> list[Part]:
    """The parts whose recordings hold command and current at the control rate."""
    return [part for part in problem.parts if _at_control_rate(part.record) and CURRENT in part.record.series]


def _at_control_rate(record: Record | OpenRecord) -> bool:
    if isinstance(record, OpenRecord):
        return record.every == 1
    e = record.experiment
    return COMMAND in record.series and e.recorded_rate == e.rig.control_rate


def looked_at(problem: Problem) -> Commands:
    """What each recording that holds command and current at the control rate shows, axis by axis."""
    found = []
    for part in _recording(problem):
        record = part.record
        commands, first = (
            (record.command, record.first) if isinstance(record, OpenRecord) else (record.series[COMMAND], 0)
        )
        pairs = zip(record.series[CURRENT], commands, strict=True)
        found.append([_looked(i[first:], u[first:]) for i, u in pairs])
    return found


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
    surely = differs > COUNTED
    # Of the mixture, the more probable half of each sample alone counts: its likelihood is rather larger.
    choices = lost.sum() * np.log(share) + (n - lost.sum()) * np.log(1 - share)
    likelier = float(n * np.log(rest / left) + 2 * choices)
    own = _Looked(likelier, int(lost[surely].sum()), int(surely.sum()))
    if not _one_as_another(lost, differs > TELLING):
        own = replace(own, likelier=0.0, lost=0, runs=_runs(lost, differs > TELLING) if likelier > LEAST else None)
    if own.likelier <= LEAST and np.mean(np.diff(command) == 0) > REPEATED:
        own = replace(own, told=0)  # if these are what is left of lost ones, nothing in the current tells them
    return own


def _one_as_another(lost: np.ndarray, told: np.ndarray) -> bool:
    """Whether commands are lost independently of whether the one before was, judged where a loss can be told."""
    both = told[1:] & told[:-1]
    before, now = lost[:-1][both], lost[1:][both]
    if not before.any() or before.all():
        return bool(before.size) and not before.all()
    return abs(float(now[before].mean()) - float(now[~before].mean())) < ALIKE + 3.0 / np.sqrt(before.sum())


def _runs(lost: np.ndarray, told: np.ndarray) -> tuple[int, int] | None:
    """How many commands are lost in turn at most, as a rule, and samples from one such run to the next, 0 where these
    differ; None with fewer than RUNS of them. A run is one in which several losses are told (samples,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(int), [0]])))
    starts, ends = edges[::2], edges[1::2]
    seen = np.concatenate([[0], np.cumsum(told)])
    runs = seen[ends] - seen[starts] >= IN_TURN
    if runs.sum() < RUNS:
        return None
    apart = np.diff(ends[runs])
    middle = int(np.median(apart))
    off = abs(apart / middle - np.maximum(np.round(apart / middle), 1.0))  # some are missed
    return int(np.quantile((ends - starts)[runs], 0.9)), middle if np.mean(off < REGULAR) > USUAL else 0


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
