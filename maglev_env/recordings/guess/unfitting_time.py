"""What a column of time that is not used, since it does not run evenly, still says of samples that are missing."""

from collections.abc import Mapping

import numpy as np

from maglev_env.recordings.contents import Contents
from maglev_env.recordings.guess.columns.column_guess import ColumnGuess
from maglev_env.recordings.guess.columns.naming import label_of
from maglev_env.recordings.guess.rate import time_scale
from maglev_env.recordings.guess.units import Unit
from maglev_env.recordings.guess.words import meaning

_MOST_FALLS = 0.01  # share of the steps at which a time may begin anew
_OTHER_RATE = 0.5  # share of the samples from which another rate is likelier than so many that are missing


def unfitting_times(columns: tuple[ColumnGuess, ...], found: Contents, rate: float) -> list[str]:
    """A sentence for each column that is called a time, is not used, and does not fit the sample rate (Hz)."""
    said = [_said(c, label_of(c.column, found), found.columns[c.column], rate, found.numbers) for c in columns]
    return [sentence for sentence in said if sentence]


def _said(
    column: ColumnGuess, label: tuple[str, Unit | None], values: np.ndarray, rate: float, numbers: Mapping[str, float]
) -> str:
    name, unit = label
    if column.channel or meaning(name, unit.si if unit else "").channel != "time" or not np.isfinite(values).all():
        return ""
    steps = np.diff(values)
    risen = steps[steps > 0]
    if not risen.size or (steps < 0).mean() > _MOST_FALLS:
        return ""
    scale = unit.scale if unit and unit.si == "s" else time_scale(values, numbers)[0]
    # What passes from stamp to stamp, but for where it begins anew; one unit of its last digit may be rounding.
    passed, digit = float(risen.sum()) * scale, float(risen.min()) * scale
    off = passed * rate - (values.size - 1 - np.count_nonzero(steps < 0))
    if abs(off) < 1 + digit * rate:
        return ""
    of = f"column {name!r}, which is not used, reaches over {passed:.6g} s"
    if abs(off) > _OTHER_RATE * values.size:
        return f"{of}: its {values.size} samples were not taken at {rate:g} Hz, or most are missing"
    return (
        f"{of}: at {rate:g} Hz about {abs(off):.0f} of {values.size} samples are {'missing' if off > 0 else 'too many'}"
    )
