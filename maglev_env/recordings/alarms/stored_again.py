"""Stretches that were stored again: a buffer that was not filled anew."""

import json
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.recordings.alarms.alarm import READINGS, Alarm, cut_to, stretches_between
from maglev_env.recordings.masking import MOST_MASKED, runs

if TYPE_CHECKING:
    import xarray as xr

LEAST_ROWS = 32  # of a stretch
MOST_DISTANCES = 16  # that are looked at
MOST_TIMES = 4.0  # lengths of its distance for which a stretch repeats; more is a cycle
MOST_AGAIN = 0.4  # share of a record that is stored again; more is a simulation without noise
MOST_ALIKE = 0.3  # probability that two noisy readings of the same motion are equal
_MAD, _SECOND = 0.6745, np.sqrt(6.0)  # of Gaussian noise: median of its size, standard deviation of second differences


def blocks_stored_again(dataset: "xr.Dataset", start: int = 0) -> list[Alarm]:
    """Stretches in which every moving channel repeats an earlier one to the last digit, which noise never does.

    Nothing is said where coarse or quiet readings may repeat, of a resampled recording, nor of a stretch whole periods
    later.
    """
    moving = [n for n in dataset.data_vars if n.partition("_")[0] in READINGS and np.ptp(dataset[n].values) > 0]
    sensed = [n for n in moving if not n.startswith("command")]
    if "row" in dataset.coords or len(moving) < 2 or not sensed:
        return []
    if min(_alike(dataset[n].values) for n in sensed) > MOST_ALIKE:
        return []
    rows = _numbered(np.stack([dataset[n].values for n in moving], axis=1))
    size, rate = rows.size, dataset.attrs["sample_rate"]
    found = {}
    for distance in _distances(rows):
        for a, b in runs(rows[distance:] == rows[:-distance]):
            if LEAST_ROWS <= b - a <= MOST_TIMES * distance and not _whole_periods(dataset, distance, rate):
                found.setdefault((a + distance, b + distance), distance)
    spells = sorted(found)
    spells = [one for i, one in enumerate(spells) if not i or one[0] >= spells[i - 1][1]]
    share = sum(b - a for a, b in spells) / size
    if not spells or share > MOST_AGAIN:
        return []
    first, last = spells[0]
    more = f", and {len(spells) - 1} more such stretches ({share:.2%} of the record)" if len(spells) > 1 else ""
    sound = max(stretches_between(spells, size), key=lambda part: part[1] - part[0])
    text = (
        f"samples {start + first} .. {start + last - 1}, from {first / rate:.4g} s on, repeat in every channel those "
        f"{found[spells[0]]} samples earlier to the last digit{more}: a buffer was stored again; leave them out: "
        f"{cut_to(dataset, start, sound)}"
    )
    severity = "refuse" if share > MOST_MASKED else "warning"
    return [Alarm("samples", "all channels", first / rate, text, severity)]


def _alike(values: np.ndarray) -> float:
    """Probability that two readings with other noise are equal: the converter's step over the width of that noise."""
    steps = np.abs(np.diff(values))
    step = float(steps[steps > 1e-6 * steps.max()].min())
    noise = float(np.median(np.abs(np.diff(values, 2)))) / (_MAD * _SECOND)
    return min(1.0, step / (2 * np.sqrt(np.pi) * max(noise, 1e-300))) if noise > step / 2 else 1.0


def _numbered(rows: np.ndarray) -> np.ndarray:
    """A number for each row (samples, channels) that equal rows share, (samples,)."""
    same = np.zeros(len(rows), np.int64)
    for values in rows.T:
        _, number = np.unique(values, return_inverse=True)
        _, same = np.unique(same * (number.max() + 1) + number, return_inverse=True)
    return same


def _distances(rows: np.ndarray) -> list[int]:
    """How many samples earlier many rows, by their numbers (samples,), stood last: the usual distances."""
    order = np.argsort(rows, kind="stable")
    distances = np.diff(order)[np.diff(rows[order]) == 0]
    counts = np.bincount(distances, minlength=1)
    often = np.argsort(-counts, kind="stable")[:MOST_DISTANCES]
    return [int(d) for d in often if d >= LEAST_ROWS and counts[d] >= LEAST_ROWS / 2]


def _whole_periods(dataset: "xr.Dataset", samples: int, rate: float) -> bool:
    """Whether so many samples are whole periods of an excitation, which a simulation without noise repeats."""
    stated = json.loads(dataset.attrs.get("experiment", "{}")).get("excitations", ())
    turns = [samples * e["fundamental"] / rate for e in stated if e.get("fundamental")]
    return any(abs(n - round(n)) < 1e-6 * max(n, 1) and n > 0.5 for n in turns)
