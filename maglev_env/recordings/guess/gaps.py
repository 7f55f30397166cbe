"""A log in which samples are missing, on the ticks of its clock: a controller went on where nothing was stored."""

from collections.abc import Mapping

import numpy as np

_FEW = 0.05  # share of the ticks that may be missing
_AFTER = 16  # ticks behind a gap in which a filter still holds what was bridged
_SAME = 0.05  # of a step, that the others may deviate from whole steps


def whole(channels: Mapping[str, np.ndarray], clock: np.ndarray | None) -> tuple[Mapping[str, np.ndarray], np.ndarray]:
    """Channels at every tick, with straight lines over those that are missing.

    Args:
        channels: (samples,) each.
        clock: time of each sample, s, (samples,); None where it is not known.

    Returns:
        The channels, (ticks,); and the ticks that were stored and lie behind no gap, (ticks,) bool. Both as they are
        where nothing is missing, or so much that no clock shows.
    """
    size = next(iter(channels.values())).size if channels else 0
    as_stored = channels, np.ones(size, bool)
    if clock is None or clock.size < 2:
        return as_stored
    steps = np.diff(clock)
    usual = float(np.median(steps))
    ticks = np.rint(steps / usual) if usual > 0 else np.zeros(0)
    if not ticks.size or ticks.min() < 1 or np.abs(steps / usual - ticks).max() > _SAME:
        return as_stored
    at = np.concatenate([[0], np.cumsum(ticks)]).astype(int)
    if at[-1] + 1 == size or size < (1 - _FEW) * (at[-1] + 1):
        return as_stored
    every = np.arange(at[-1] + 1)
    known = np.zeros(every.size, bool)
    known[at] = True
    behind = np.convolve(~known, np.ones(_AFTER + 1))[: every.size] > 0.5
    return {name: np.interp(every, at, values) for name, values in channels.items()}, ~behind
