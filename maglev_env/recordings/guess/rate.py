"""The sample rate: from the time column, or from a single number of the file that is called so."""

import re
from collections.abc import Mapping

import numpy as np

from maglev_env.recordings.guess.evidence import LIKELY, SURE, Guess

_ROUND = 5e-5  # a rate so near to a round number is that number
_RATES = re.compile(r"(^|[._])(fs|f_s|rate|samplerate|sample_rate|samplingrate|sampling_rate|abtastrate)$", re.I)
_STEPS = re.compile(
    r"(^|[._])(dt|ts|t_s|samplingperiod|sampling_period|sampletime|sample_time|abtastzeit|wf_increment)$", re.I
)


def guess_rate(time: np.ndarray | None, scale: float, numbers: Mapping[str, float], label: str = "time") -> Guess:
    """The sample rate in Hz.

    Args:
        time: column of time (samples,); None where there is none.
        scale: seconds in one of its units.
        numbers: single numbers of the file by name.
        label: name of the column.

    Returns:
        The rate with its evidence; its value is None where the file does not tell it.
    """
    if time is not None:
        steps = np.diff(time) * scale
        middle = float(np.median(steps))
        jitter = float(np.std(steps[np.abs(steps - middle) < 0.5 * middle]) / middle)
        if not 1e-7 < middle < 10:
            return Guess("sample_rate", None, f"steps of {middle:g} s in column {label}", 0.0, "sample rate in Hz")
        if scale == 1 and middle == 1:
            ask = "sample rate in Hz (column {label} counts samples)"
            return Guess("sample_rate", None, f"column {label} counts samples", 0.0, ask.format(label=label))
        mean = float((time[-1] - time[0]) * scale / (time.size - 1))
        rate = _nice(1 / mean)
        reason = (
            f"{rate:g} Hz: mean step of column {label} {mean:.6g} s, median {middle:.6g} s, jitter {jitter:.2g} rms"
        )
        if abs(mean / middle - 1) > 0.01:
            return Guess(
                "sample_rate", _nice(1 / middle), f"{reason}: samples are missing", LIKELY, "sample rate in Hz"
            )
        return Guess("sample_rate", rate, reason, SURE)
    for name, value in numbers.items():
        if _RATES.search(name) and value > 0:
            return Guess("sample_rate", value, f"{value:g} Hz: the number {name} of the file", SURE)
        if _STEPS.search(name) and 0 < value < 10:
            return Guess("sample_rate", _nice(1 / value), f"{1 / value:g} Hz: the step {name} = {value:g} s", SURE)
    return Guess("sample_rate", None, "no column of time, and no number that tells it", 0.0, "sample rate in Hz")


def jitter_of(time: np.ndarray) -> float:
    """Largest deviation of a time step from the mean step, as a share of it."""
    steps = np.diff(time)
    return float(np.abs(steps / steps.mean() - 1).max())


def _nice(rate: float) -> float:
    """The nearest round number, where one is near enough; else the rate."""
    for digits in (1, 2, 3, 4):
        rounded = float(f"{rate:.{digits}g}")
        if abs(rounded / rate - 1) < _ROUND:
            return rounded
    return rate
