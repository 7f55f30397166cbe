"""What the linearised loop does between the lines of an experiment, where a sharp resonance shows on none of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimation.gain_margin import LOWEST, gain_factors
from estimation.lines.curves import REFINEMENT, refined_grid
from estimation.stability_margins import margin_arrays, margins_of_curves
from maglev_env.experiment import Experiment
from maglev_env.linear.poles import all_poles

NAMES = ("peak_sensitivity", "peak_frequency", "phase_margin", "gain_margin", "disk_margin")
# Factor by which a peak, a phase margin or a disk margin is worse than a curve through the lines has it, from which on
# it counts as hidden between them.
HIDDEN = 1.05
CAUTION = 1.02  # factor below HIDDEN from which on a loop is looked at closely
EVENLY = 60  # frequencies between two lines around a narrow pole
# Distances from such a pole, times half its width at half power: a thousandth of the peak is lost between them.
BESIDE = np.concatenate([[0.0], np.geomspace(0.1, 1e3, 49)])
CLOSER = 4  # times as many frequencies, once a loop is looked at closely: the peak is then right within 1e-4
CLOSE = 1e-9  # of a frequency
TOP = 0.49  # of the control rate, up to which a loop is looked at


def between_lines(
    experiments: Sequence[Experiment], poles: Sequence[np.ndarray], lines: np.ndarray, axis: int = 0
) -> dict[str, np.ndarray]:
    """Margins of the linearised loops at all frequencies, nan where the lines show as much; (n,) by NAMES.

    A pole that is narrower than the distance of the lines beside it may be a peak of |S| that none of them shows. With
    gains over a wide range every third loop has such a pole and every thirtieth hides something; all are looked at
    together first, and only those that may hide something one by one.

    Args:
        experiments: n of them.
        poles: Of each, by `poles.all_poles`.
        lines: Increasing frequencies (f,), Hz, f >= 4, at which the sensitivity is measured.
        axis: 0 (x) or 1 (y), whose loop is meant.

    Returns:
        peak_sensitivity, its peak_frequency in Hz, phase_margin in degrees, gain_margin (the smaller of the factors by
        which the gain may rise and fall) and disk_margin.
    """
    found = {name: np.full(len(experiments), np.nan) for name in NAMES}
    rate = experiments[0].rig.control_rate
    beside = _Beside.of_narrow(poles, lines, rate)
    own = np.unique(beside.loop)
    if not own.size:
        return found
    broken = all_poles([experiments[i] for i in own], without=axis)
    loops = _Loops(_padded(broken), _padded([poles[i] for i in own]), rate)
    seen = margin_arrays(lines, loops.sensitivity(lines))
    for k in _may_hide(beside, loops, seen, lines):
        whole = _whole(beside.of(own[k]), loops.chosen([k]), lines)
        if _hides({name: values[k] for name, values in seen.items()}, whole):
            for name in NAMES:
                found[name][own[k]] = whole[name]
    return found


@dataclass(frozen=True)
class _Loops:
    """Loops by the poles (n, p) of each broken at one axis and closed, and their control rate in Hz."""

    broken: np.ndarray
    closed: np.ndarray
    rate: float

    def chosen(self, which: np.ndarray | list[int]) -> "_Loops":
        """Those of some numbers, any of them several times."""
        return _Loops(self.broken[which], self.closed[which], self.rate)

    def sensitivity(self, frequency: np.ndarray) -> np.ndarray:
        """Sensitivities (n, f) of the axis at frequencies (f,), or at those of each loop (n, f), Hz.

        1 / S of an axis is the determinant of the closed loop over that of the loop broken there. Both are products of
        distances from poles, which takes a tenth of the time of `loop.loop_response`.
        """
        z = np.exp(2j * np.pi / self.rate * frequency)
        over, under = np.ones((2, len(self.closed), z.shape[-1]), complex)
        for a, b in zip(self.broken.T, self.closed.T, strict=True):
            over *= z - a[:, None]
            under *= z - b[:, None]
        return over / under


@dataclass(frozen=True)
class _Beside:
    """Poles that are narrower than the distance of the lines around them, (k,) each.

    Args:
        loop: number of the loop that has it.
        at: frequency, Hz.
        half: half the width at half power, Hz.
        low: the line below it, or 0 Hz.
        high: the line above it, or TOP of the control rate.
    """

    loop: np.ndarray
    at: np.ndarray
    half: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of_narrow(cls, poles: Sequence[np.ndarray], lines: np.ndarray, rate: float) -> "_Beside":
        """Those of each of many loops; none of an unstable one."""
        stable = np.array([np.abs(own).max() < 1 for own in poles])
        loop, flat = np.repeat(np.arange(len(poles)), [len(own) for own in poles]), np.concatenate(poles)
        kept = stable[loop] & (flat.imag > 0)
        loop, flat = loop[kept], flat[kept]
        at, half = np.angle(flat) * rate / (2 * np.pi), -np.log(np.abs(flat)) * rate / (2 * np.pi)
        edges = np.concatenate([[0.0], lines, [TOP * rate]])
        above = np.searchsorted(edges, at).clip(1, len(edges) - 1)
        low, high = edges[above - 1], edges[above]
        narrow = half < high - low
        return cls(*(own[narrow] for own in (loop, at, half, low, high)))

    def of(self, loop: int) -> "_Beside":
        """Those of one loop."""
        return _Beside(*(values[self.loop == loop] for values in vars(self).values()))

    def frequencies(self) -> np.ndarray:
        """Frequencies around each, (k, f), Hz, from one line to the next and near the pole, in no order."""
        near, at = self.half[:, None] * BESIDE, self.at[:, None]
        return np.concatenate([np.linspace(self.low, self.high, EVENLY + 2, axis=1), at + near, at - near], axis=1)


def _may_hide(beside: _Beside, loops: _Loops, seen: Mapping[str, np.ndarray], lines: np.ndarray) -> np.ndarray:
    """Which of the loops that have a narrow pole, by number among these, may be worse beside it than they are `seen`.

    The loops' values there are taken as they are, so one that is not far below HIDDEN is told, too.
    """
    row = np.unique(beside.loop, return_inverse=True)[1]
    frequency = np.sort(np.clip(beside.frequencies(), lines[0] / 2, TOP * loops.rate), axis=1)
    s = loops.chosen(row).sensitivity(frequency)
    near = HIDDEN / CAUTION
    worse = np.abs(s).max(axis=1) > near * seen["peak_sensitivity"][row]
    worse |= np.abs(s - 0.5).max(axis=1) * seen["disk_margin"][row] > near
    gain = 1 / s - 1
    level = np.abs(gain) ** 2 - 1
    loop, i = np.nonzero((level[:, 1:] > 0) != (level[:, :-1] > 0))
    part = level[loop, i] / (level[loop, i] - level[loop, i + 1])
    crossing = gain[loop, i] + part * (gain[loop, i + 1] - gain[loop, i])
    least = np.full(len(s), np.inf)
    np.minimum.at(least, loop, np.degrees(np.abs(np.angle(-crossing))))
    worse |= near * least < np.nan_to_num(seen["phase_margin"][row], nan=np.inf)
    return np.unique(row[worse])


def _whole(beside: _Beside, loop: _Loops, lines: np.ndarray) -> dict[str, np.ndarray]:
    """Margins of one loop, of its values themselves on a fine grid.

    No curve is laid through them: one through points that are close together beside a pole and far apart elsewhere
    swings there.
    """
    between = beside.frequencies()
    between = np.unique(between[(between > lines[0] / 2) & (between < TOP * loop.rate)])
    frequency = _joined(*(np.exp(refined_grid(np.log(f), n)) for f, n in ((lines, REFINEMENT), (between, CLOSER))))
    whole = margins_of_curves(np.log(frequency), 1 / loop.sensitivity(frequency)[0] - 1)
    lowest = _joined(lines[:LOWEST], between[:LOWEST])
    whole["gain_margin"] = np.fmin(*gain_factors(lowest, loop.sensitivity(lowest)[0], whole))
    return whole


def _padded(poles: Sequence[np.ndarray]) -> np.ndarray:
    """Poles of n loops, (n, p); a loop with fewer has more at the origin, in `_Loops` as many broken as closed."""
    found = np.zeros((len(poles), max(map(len, poles))), complex)
    for row, own in zip(found, poles, strict=True):
        row[: len(own)] = own
    return found


def _joined(*frequencies: np.ndarray) -> np.ndarray:
    """All of several sets of frequencies, increasing, and one of each few that all but meet."""
    found = np.unique(np.concatenate(frequencies))
    return found[np.diff(np.log(found), prepend=-np.inf) > CLOSE]


def _hides(seen: Mapping[str, np.ndarray], whole: Mapping[str, np.ndarray]) -> bool:
    """Whether a loop is worse at all frequencies than at its lines; a crossing that these do not have is worse."""
    if whole["peak_sensitivity"] > HIDDEN * seen["peak_sensitivity"]:
        return True
    least = ("phase_margin", "disk_margin")
    return any(HIDDEN * whole[name] < np.nan_to_num(seen[name], nan=np.inf) for name in least)
