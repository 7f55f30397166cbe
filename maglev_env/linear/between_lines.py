"""What the linearised loop does between the lines of an experiment, where a sharp resonance shows on none of them."""

from collections.abc import Mapping, Sequence

import numpy as np

from estimation.gain_margin import gain_factors
from estimation.stability_margins import margin_arrays
from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response

NAMES = ("peak_sensitivity", "peak_frequency", "phase_margin", "gain_margin", "disk_margin")
# Factor by which a peak, a phase margin or a disk margin is worse than a curve through the lines has it, from which on
# it counts as hidden between them.
HIDDEN = 1.05
EVENLY = 60  # frequencies between two lines around a narrow pole
# Distances from such a pole, times half its width at half power: a thousandth of the peak is lost between them.
BESIDE = np.concatenate([[0.0], np.geomspace(0.1, 1e3, 49)])
CLOSE = 1e-9  # of a frequency
TOP = 0.49  # of the control rate, up to which a loop is looked at


def between_lines(
    experiments: Sequence[Experiment], poles: Sequence[np.ndarray], lines: np.ndarray, axis: int = 0
) -> dict[str, np.ndarray]:
    """Margins of the linearised loops at all frequencies, nan where the lines show as much; (n,) by NAMES.

    A pole that is narrower than the distance of the lines beside it may be a peak of |S| that none of them shows. Only
    loops with such a pole are looked at again, so that this costs next to nothing where there are none.

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
    for i, (e, own) in enumerate(zip(experiments, poles, strict=True)):
        between = _beside_narrow(own, lines, e.rig.control_rate)
        if not between.size:
            continue
        frequency = _joined(between, lines)
        s = loop_response(e, frequency).sensitivity
        s = s if s.ndim == 1 else s[:, axis, axis]
        seen, whole = margin_arrays(lines, s[np.isin(frequency, lines)]), margin_arrays(frequency, s)
        if not _hides(seen, whole):
            continue
        whole["gain_margin"] = np.fmin(*gain_factors(frequency, s, whole))
        for name in NAMES:
            found[name][i] = whole[name]
    return found


def _joined(between: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """The lines and the frequencies between them, without those that all but coincide: no curve passes these."""
    between = np.unique(between)
    log = np.log(between)
    away = np.abs(log[:, None] - np.log(lines)).min(axis=1) > CLOSE
    return np.union1d(lines, between[away & (np.diff(log, prepend=-np.inf) > CLOSE)])


def _hides(seen: Mapping[str, np.ndarray], whole: Mapping[str, np.ndarray]) -> bool:
    """Whether a loop is worse at all frequencies than at its lines; a crossing that these do not have is worse."""
    if whole["peak_sensitivity"] > HIDDEN * seen["peak_sensitivity"]:
        return True
    least = ("phase_margin", "disk_margin")
    return any(HIDDEN * whole[name] < np.nan_to_num(seen[name], nan=np.inf) for name in least)


def _beside_narrow(poles: np.ndarray, lines: np.ndarray, rate: float) -> np.ndarray:
    """Frequencies beside the poles that are narrower than the distance of the lines around them; none if unstable."""
    if np.abs(poles).max() >= 1:
        return np.empty(0)
    poles = poles[(poles.imag > 0) & (np.abs(poles) > 0)]
    at, half = np.angle(poles) * rate / (2 * np.pi), -np.log(np.abs(poles)) * rate / (2 * np.pi)
    edges = np.concatenate([[0.0], lines, [TOP * rate]])
    above = np.searchsorted(edges, at).clip(1, len(edges) - 1)
    low, high = edges[above - 1], edges[above]
    parts = [
        np.concatenate([np.linspace(a, b, EVENLY + 2)[1:-1], f + h * BESIDE, f - h * BESIDE])
        for f, h, a, b in zip(at, half, low, high, strict=True)
        if h < b - a
    ]
    found = np.concatenate([np.empty(0), *parts])
    return found[(found > lines[0] / 2) & (found < TOP * rate)]
