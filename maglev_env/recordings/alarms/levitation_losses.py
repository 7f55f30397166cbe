"""When levitation is lost: the rotor is at a stop, or out of its working range while the command is at a limit."""

import numpy as np

from maglev_env.recordings.masking import runs

REST_SHARE = 0.3  # of such a time that the rotor is at a stop, as none does that overshoots
RAIL_WIDTH, RAIL_DWELL = 0.01, 0.7  # of the range; a sine dwells in its outer 1 % half as long as in its outer 4 %
STOP_WIDTH = 0.1  # of the range of the readings
NEAR_STOP = 0.05  # of the clearance: how well it is known, and how near no loop works
CHATTER = 0.4  # share of a window at a limit or stop: noise takes the command off it, and a rotor bounces
CAUGHT = 4  # of the shortest loss between two: in less the rotor only bounces from stop to stop
# Swing of the command, of its range, while a reading is flat near the end of its range; and while it is at the very
# end for as long as a rotor needs to be caught.
SWING, LONG_SWING = 0.25, 0.15
# The working range is the middle half of the controlled readings, wider by so many times its width on either side: 2.5
# amplitudes of a sine. Quartiles, because a record that is lost half of the time moves from stop to stop in between.
WIDENED = 1.25


def levitation_losses(
    y: np.ndarray, effort: np.ndarray, wanted: np.ndarray | None, stay: int, clearance: float
) -> tuple[list[tuple[int, int]], tuple[float, float]]:
    """First and end of every loss of levitation, and the working range, m; (0, 0) where nothing is left to tell it.

    Args:
        y: Displacement, (samples,), m.
        effort: Command, voltage or current, (samples,).
        wanted: Reference, (samples,), m; None without one.
        stay: Samples that count.
        clearance: Of the rig, m; infinite where it is not known.
    """
    least, most = np.quantile(y, (0.005, 0.995))
    touching = _mostly(np.abs(y) >= (1 - NEAR_STOP) * clearance, stay, CHATTER)
    stop = touching | (np.minimum(y - least, most - y) <= STOP_WIDTH * (most - least))
    # A rotor at a stop is where it never goes beyond; elsewhere a flat reading is the sensor's. The controller works
    # against the stop, while it rests where a loop only rests.
    idle, flat = _at_rail(effort, stay), _flat(y, stay)
    for first, last in runs(flat & stop):
        swing, part = np.ptp(effort[first:last]) / (np.ptp(effort) or 1.0), slice(first, last)
        if y[first] in (y.min(), y.max()):
            touching[part] |= swing > (LONG_SWING if last - first >= CAUGHT * stay else SWING)
        idle[part] |= swing > SWING
    working = y[~(idle | flat | touching)]
    low = high = 0.0
    lost = touching
    if working.size >= 2 * stay:
        low, high = np.quantile(working, (0.25, 0.75))
        low, high = low - WIDENED * (high - low), high + WIDENED * (high - low)
        if wanted is not None:
            low, high = min(low, wanted.min()), max(high, wanted.max())
        low, high = max(low, -clearance), min(high, clearance)
        lost = touching | _mostly(((y < low) | (y > high)) & idle, stay)
    joined: list[tuple[int, int]] = []
    rested: list[bool] = []
    for first, last in runs(lost):
        rests = bool(stop[first:last].mean() >= REST_SHARE)
        if joined and first - joined[-1][1] < CAUGHT * stay:
            first, rests = joined.pop()[0], rests | rested.pop()
        joined.append((first, last))
        rested.append(rests)
    return [run for run, rests in zip(joined, rested, strict=True) if rests], (float(low), float(high))


def _flat(values: np.ndarray, stay: int) -> np.ndarray:
    """Samples in runs of one value that last at least `stay`."""
    out = np.zeros(values.size, bool)
    for first, last in runs(np.diff(values) == 0):
        if last + 1 - first >= stay:
            out[first : last + 1] = True
    return out


def _at_rail(effort: np.ndarray, stay: int) -> np.ndarray:
    """Samples at the largest or smallest effort, where the record dwells there as at a limit."""
    span, out = np.ptp(effort), np.zeros(effort.size, bool)
    for distance in (effort.max() - effort, effort - effort.min()):
        near = distance <= RAIL_WIDTH * span
        if near.sum() >= max(stay, RAIL_DWELL * (distance <= 4 * RAIL_WIDTH * span).sum()):
            out |= _mostly(near, stay, CHATTER)
    return out


def _mostly(at: np.ndarray, stay: int, share: float = 0.8) -> np.ndarray:
    """Windows of `stay` samples in which `at` holds for at least a share of them, from the first to the last at which
    it does: (samples,) bool."""
    if at.size < stay:
        return np.zeros_like(at)
    sums = np.concatenate([[0], np.cumsum(at)])
    starts = np.flatnonzero(sums[stay:] - sums[:-stay] >= share * stay)
    edges = np.zeros(at.size + 1, int)
    np.add.at(edges, starts, 1)
    np.add.at(edges, starts + stay, -1)
    out = np.cumsum(edges)[:-1] > 0
    for first, last in runs(out):
        held = first + np.flatnonzero(at[first:last])
        out[first : held[0]] = out[held[-1] + 1 : last] = False
    return out
