"""What the linearised loop does between the lines of an experiment, where a sharp resonance shows on none of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimation.gain_margin import gain_factors
from estimation.stability_margins import margin_arrays
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
    closed = _padded([poles[i] for i in own])
    broken = _padded(all_poles([experiments[i] for i in own], axis))
    seen = margin_arrays(lines, _sensitivity(np.broadcast_to(lines, (own.size, lines.size)), broken, closed, rate))
    for k in _may_hide(beside, seen, broken, closed, lines, rate):
        frequency = _joined(beside.of(own[k]).frequencies(), lines, rate)
        s = _sensitivity(frequency[None], broken[k : k + 1], closed[k : k + 1], rate)[0]
        whole = margin_arrays(frequency, s)
        if not _hides({name: values[k] for name, values in seen.items()}, whole):
            continue
        whole["gain_margin"] = np.fmin(*gain_factors(frequency, s, whole))
        for name in NAMES:
            found[name][own[k]] = whole[name]
    return found


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


def _may_hide(
    beside: _Beside,
    seen: Mapping[str, np.ndarray],
    broken: np.ndarray,
    closed: np.ndarray,
    lines: np.ndarray,
    rate: float,
) -> np.ndarray:
    """Which of the loops that have a narrow pole, by number among these, may be worse beside it than it is `seen`.

    The loop's values there are taken without a curve through them, so one that is not far below HIDDEN is told, too.
    """
    row = np.unique(beside.loop, return_inverse=True)[1]
    frequency = np.sort(np.clip(beside.frequencies(), lines[0] / 2, TOP * rate), axis=1)
    s = _sensitivity(frequency, broken[row], closed[row], rate)
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


def _sensitivity(frequency: np.ndarray, broken: np.ndarray, closed: np.ndarray, rate: float) -> np.ndarray:
    """Sensitivities (n, f) of n loops at frequencies (n, f), Hz, of the poles (n, p) of the broken and the closed loop.

    1 / S of an axis is the determinant of the closed loop over that of the loop broken there. Both are products of
    distances from poles, which takes a tenth of the time of `loop.loop_response`.
    """
    z = np.exp(2j * np.pi / rate * frequency)
    over, under = np.ones_like(z), np.ones_like(z)
    for a, b in zip(broken.T, closed.T, strict=True):
        over *= z - a[:, None]
        under *= z - b[:, None]
    return over / under


def _padded(poles: Sequence[np.ndarray]) -> np.ndarray:
    """Poles of n loops, (n, p); a loop with fewer has more at the origin, in `_sensitivity` as many above as below."""
    found = np.zeros((len(poles), max(map(len, poles))), complex)
    for row, own in zip(found, poles, strict=True):
        row[: len(own)] = own
    return found


def _joined(between: np.ndarray, lines: np.ndarray, rate: float) -> np.ndarray:
    """The lines and the frequencies between them, without those that all but coincide: no curve passes these."""
    between = np.unique(between[(between > lines[0] / 2) & (between < TOP * rate)])
    log = np.log(between)
    away = np.abs(log[:, None] - np.log(lines)).min(axis=1) > CLOSE
    return np.union1d(lines, between[away & (np.diff(log, prepend=-np.inf) > CLOSE)])


def _hides(seen: Mapping[str, np.ndarray], whole: Mapping[str, np.ndarray]) -> bool:
    """Whether a loop is worse at all frequencies than at its lines; a crossing that these do not have is worse."""
    if whole["peak_sensitivity"] > HIDDEN * seen["peak_sensitivity"]:
        return True
    least = ("phase_margin", "disk_margin")
    return any(HIDDEN * whole[name] < np.nan_to_num(seen[name], nan=np.inf) for name in least)
