"""Samples that are there but tell nothing, clipped or missing: a mask over time, and how it is respected."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

# Clipping lowers the gain of a Gaussian signal by just the share of the samples that are clipped (Bussgang), and what
# is bridged instead leaves a fraction of that. At one percent this reaches the accuracy of a good calibration; beyond
# it, the record says more of its converter than of the rig.
MOST_MASKED = 0.01
# A clipped channel stays at its extreme value and passes the values next to it quickly. A quantised sine also stays at
# its top level, but at most 2.4 times as long as at the next one, and 1.4 times as long as at the next two, which tell
# where a few samples of a flat peak pass one level by chance.
CLIPPED_SHARE, CLIPPED_RUN, CLIPPED_RATIOS = 1e-3, 4, (6, 2)
SEVERAL, AS_LONG = 2, 0.5  # levels inside that are held too; the longest run at the extreme, as a share of theirs
LEAST_PERIODS = 4  # that must remain for masked periods to be left out: noise from fewer is poorly known


def masked_samples(dataset: "xr.Dataset") -> np.ndarray:
    """The mask of a recording, (samples,) bool: True where a sample was clipped or missing."""
    return dataset["masked"].values if "masked" in dataset.coords else np.zeros(dataset.sizes["time"], bool)


def clipped_samples(values: np.ndarray) -> np.ndarray:
    """Where a column (samples,) stays at its extreme value as a clipped one does, (samples,) bool."""
    clipped = np.zeros(values.size, bool)
    for level, nearest in ((values.max(), np.max), (values.min(), np.min)):
        at = values == level
        run = at[: 1 - CLIPPED_RUN].copy()
        for shift in range(1, CLIPPED_RUN):
            run &= at[shift : at.size - CLIPPED_RUN + 1 + shift]
        if not run.any() or at.all():
            continue
        beside, rest, passed = 0, values[~at], at.mean() >= CLIPPED_SHARE
        for ratio in CLIPPED_RATIOS:
            if rest.size:
                kept = rest[rest != nearest(rest)]
                beside, rest = beside + rest.size - kept.size, kept
                passed &= at.sum() >= ratio * beside
        if passed and not _one_of_several(values, at):
            clipped |= at
    return clipped


def _one_of_several(values: np.ndarray, at: np.ndarray) -> bool:
    """Whether two or more levels within a column (samples,) are held as flatly and as long as the extreme, `at`.

    A coarse converter shows the steps of a set point so. One level alone may be the rest beside a burst that is cut
    off, and one that overshoots is cut off for a short while only.
    """
    levels, counts = np.unique(values, return_counts=True)
    beside = np.pad(counts, 2)
    near = beside[1:-3] + beside[3:-1]
    flat = (counts >= CLIPPED_RATIOS[0] * near) & (counts >= CLIPPED_RATIOS[1] * (near + beside[:-4] + beside[4:]))
    flat &= counts >= CLIPPED_SHARE * values.size
    held = [_longest(values == level) for level in levels[1:-1][flat[1:-1]]]
    held = [run for run in held if run >= CLIPPED_RUN]
    return len(held) >= SEVERAL and bool(_longest(at) >= AS_LONG * np.median(held))


def _longest(at: np.ndarray) -> int:
    """The longest run of True, samples."""
    return max((end - first for first, end in runs(at)), default=0)


def runs(at: np.ndarray) -> list[tuple[int, int]]:
    """First and end of every run of True of (samples,)."""
    edges = np.flatnonzero(np.diff(np.pad(at, 1).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def bridged(values: np.ndarray, masked: np.ndarray) -> np.ndarray:
    """Values (samples,) with straight lines in place of the masked samples."""
    if not masked.any() or masked.all():
        return values
    at = np.arange(values.size)
    return np.where(masked, np.interp(at, at[~masked], values[~masked]), values)


def masked_periods(masked: np.ndarray, samples: int) -> tuple[int, ...]:
    """The periods of so many samples that hold masked ones, where enough others remain to leave them out; else none."""
    whole = masked.size // samples
    holds = masked[: whole * samples].reshape(whole, samples).any(axis=1)
    return tuple(map(int, np.flatnonzero(holds))) if (~holds).sum() >= max(LEAST_PERIODS, whole / 2) else ()
