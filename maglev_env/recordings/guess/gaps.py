"""A log in which samples are missing, on the ticks of its clock: a controller went on where nothing was read."""

from collections.abc import Mapping

import numpy as np

_FEW = 0.05  # share of the ticks that may be missing
_AFTER = 16  # ticks behind a gap in which a filter still holds what was bridged
_SAME = 0.05  # of a step, that the others may deviate from whole steps


def whole(
    channels: Mapping[str, np.ndarray], clock: np.ndarray | None, unread: np.ndarray | None = None
) -> tuple[Mapping[str, np.ndarray], np.ndarray]:
    """Channels at every tick, with straight lines over those that are missing.

    Args:
        channels: (samples,) each.
        clock: time of each sample, s, (samples,); None where it is not known.
        unread: samples whose readings were bridged or clipped, (samples,) bool; None: none was.

    Returns:
        The channels, (ticks,); and the ticks that were read and lie behind no gap, (ticks,) bool. The channels are as
        they were where nothing is missing, or so much that no clock shows.
    """
    size = next(iter(channels.values())).size if channels else 0
    unread = np.zeros(size, bool) if unread is None else unread
    at = None if clock is None else _ticks(clock)
    if at is None or not (1 - _FEW) * (at[-1] + 1) <= size <= at[-1]:
        return channels, ~_behind(unread)
    every = np.arange(at[-1] + 1)
    gone = np.ones(every.size, bool)
    gone[at] = unread
    return {name: np.interp(every, at, values) for name, values in channels.items()}, ~_behind(gone)


def _ticks(clock: np.ndarray) -> np.ndarray | None:
    """The tick of each sample (samples,), from 0; None where the steps of the clock are no whole multiples of one."""
    steps = np.diff(clock)
    usual = float(np.median(steps)) if steps.size else 0.0
    ticks = np.rint(steps / usual) if usual > 0 else np.zeros(0)
    if not ticks.size or ticks.min() < 1 or np.abs(steps / usual - ticks).max() > _SAME:
        return None
    return np.concatenate([[0], np.cumsum(ticks)]).astype(int)


def _behind(gone: np.ndarray) -> np.ndarray:
    """The samples that are gone, and those in which a filter still holds what stands in their place, (samples,)."""
    return np.convolve(gone, np.ones(_AFTER + 1))[: gone.size] > 0.5 if gone.size else gone
