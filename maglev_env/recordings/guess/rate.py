"""The sample rate: from the time column, or from a single number of the file that is called so."""

import re
from collections.abc import Mapping

import numpy as np

from maglev_env.recordings.formats.time_stamps import coarse_step, rounded_step
from maglev_env.recordings.guess.evidence import LIKELY, OPEN, SURE, Guess
from maglev_env.recordings.guess.units import header_unit
from maglev_env.recordings.guess.words import unaccented

_ROUND = 5e-5  # a rate so near to a round number is that number
_SURELY, _MOST_ROUND = 3.0, 5e-3  # standard errors of a jittering clock's rate within which it is, and at most
_BLOCKS = 12
_FRENCH = "d_?echantillonnage"
_SAMPLES = r"sampl(e|ing)"
# Of a name's last part only these words are the sample's own; a rate alone must be the whole part, since that of bauds,
# of the control or of an image is another one.
_RATES = re.compile(
    rf"(^|[._])(fs|f_s|(?P<own>{_SAMPLES}_?(rate|freq(uency)?)|abtast(rate|frequenz)|frequence_{_FRENCH}"
    r"|(acquisition|scan|logging|log|record(ing)?|daq)_?rate))$|(^|\.)rate$",
    re.IGNORECASE,
)
_STEPS = re.compile(
    rf"(^|[._])(dt(_s(ec)?)?|ts|t_s|(?P<own>{_SAMPLES}_?(period|time|interval)|abtast(zeit|intervall)|wf_increment"
    rf"|(x_?)?increment|delta_?x|periode_{_FRENCH}))$",
    re.IGNORECASE,
)
STATED_RATE = "--rate"  # among the numbers of a file, the rate that the user states, Hz
_AS_STATED = 0.01  # relative deviation of a stated step from that of the column
_FEW_GAPS = 0.05  # share of steps that may be several, where samples are missing
_SLOWEST = 40.0  # Hz of control with which anything levitates
_FASTEST = 2e5  # Hz at which a levitated rotor is recorded
_DAYS = ((20_000, 80_000), (700_000, 800_000))  # of this century and the last, as spreadsheets and MATLAB count them


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
        if coarse := coarse_step(time * scale):
            rate = _nice(1 / coarse[0], coarse[1] / coarse[0])
            reason = f"{rate:.6g} Hz: mean step of column {label} {coarse[0]:.6g} s, whose stamps repeat"
            return Guess("sample_rate", rate, reason, SURE, "sample rate in Hz" if rate < _SLOWEST else "")
        steps = np.diff(time) * scale
        middle = float(np.median(steps))
        if not 1e-7 < middle < 10:
            return Guess("sample_rate", None, f"steps of {middle:g} s in column {label}", 0.0, "sample rate in Hz")
        if scale == 1 and middle == 1:
            ask = "sample rate in Hz (column {label} counts samples)"
            return Guess("sample_rate", None, f"column {label} counts samples", 0.0, ask.format(label=label))
        # Where a step is there and others are whole multiples of it, samples are missing, and the clock is right.
        times = np.round(steps / middle)
        few = bool(np.mean(times != 1) < _FEW_GAPS)
        mean = float((time[-1] - time[0]) * scale / (times.sum() if few else time.size - 1))
        rate = _nice(1 / mean, _SURELY * _unsure(steps[times == 1]))
        reason = f"{rate:g} Hz: mean step of column {label} {mean:.6g} s, median {middle:.6g} s, "
        reason += f"jitter {jitter_of(time):.2g} rms"
        if not few and abs(mean / middle - 1) > 0.01:
            if rounded := rounded_step(time * scale):
                rate = _nice(1 / rounded[0], rounded[1] / rounded[0])
                reason = f"{rate:.6g} Hz: mean step of column {label} {mean:.6g} s, whose stamps are rounded"
                return Guess("sample_rate", rate, reason, SURE)
            return Guess(
                "sample_rate", _nice(1 / middle), f"{reason}: samples are missing", LIKELY, "sample rate in Hz"
            )
        return Guess("sample_rate", rate, reason, SURE)
    if stated := _stated_steps(numbers):
        step, where = stated[0]
        rate = _nice(1 / step)
        ask = "sample rate in Hz" if STATED_RATE not in numbers and (len(stated) > 1 or rate < _SLOWEST) else ""
        but = "".join(f", but {other} is another one" for _, other in stated[1:])
        return Guess("sample_rate", rate, f"{rate:g} Hz: {where}{but}", OPEN if ask else SURE, ask)
    return Guess("sample_rate", None, "no column of time, and no number that tells it", 0.0, "sample rate in Hz")


def stated_step(numbers: Mapping[str, float]) -> tuple[float, str] | None:
    """The time between two samples that a single number of the file states, s, and where; None without one."""
    return next(iter(_stated_steps(numbers)), None)


def _stated_steps(numbers: Mapping[str, float]) -> list[tuple[float, str]]:
    """The steps that numbers of the file state, s, and where: the first, and others only where they differ from it.

    The user's own is the only one; what is called the sample's goes before what is called a rate or a step alone.
    """
    if rate := numbers.get(STATED_RATE):
        return [(1 / rate, f"the stated rate of {rate:g} Hz")]
    found: dict[bool, list[tuple[float, str]]] = {True: [], False: []}
    for name, value in numbers.items():
        called, unit = header_unit(name)
        called = re.sub(r"\W+" if unit else r"[^\w.]+", "_", unaccented(called))
        rate, step = _RATES.search(called), _STEPS.search(called)
        if (said := rate or step) is None:
            continue
        si, size = (unit.si, value * unit.scale) if unit else ("Hz" if rate else "s", value)
        if si == "Hz" and size > 0:
            found[bool(said["own"])].append((1 / size, f"the {size:g} Hz of {name}"))
        if si == "s" and 0 < size < 10:
            text = unit.text if unit else "s"
            found[bool(said["own"])].append((size, f"the step {name} = {value:g} {text}"))
    steps = found[True] or found[False]
    return steps[:1] + [other for other in steps[1:] if abs(other[0] / steps[0][0] - 1) > _AS_STATED]


def time_scale(time: np.ndarray, numbers: Mapping[str, float]) -> tuple[float, str, str]:
    """The unit of a column of time whose name states none.

    Args:
        time: the column (samples,).
        numbers: single numbers of the file by name.

    Returns:
        Seconds in one of its units, the evidence, and what the user should state.
    """
    coarse = coarse_step(time)
    middle = coarse[0] if coarse else float(np.median(np.diff(time)))
    if middle > 0 and (stated := stated_step(numbers)):
        for scale in (1.0, 1e-3, 1e-6, 1e-9):
            if abs(middle * scale / stated[0] - 1) < _AS_STATED:
                return scale, f"no unit, taken as {scale:g} s: {stated[1]}", ""
        if middle == 1 or (STATED_RATE in numbers and not (time % 1).any() and not coarse):
            of = "samples" if middle == 1 else f"{middle:g} a sample"
            return stated[0] / middle, f"counts {of}: {stated[1]}", ""
    days = any(first <= time[0] <= last for first, last in _DAYS) and 0 < middle < 1 / _FASTEST
    if days:
        return 86400.0, f"no unit, days by their size, since {1 / middle:.3g} Hz are too many", "unit of time"
    if middle == 1 or not 1 < middle * _SLOWEST < 1e9 * _SLOWEST:
        return 1.0, "no unit, taken as s", ""
    scale, name = next(((s, n) for s, n in ((1e-3, "ms"), (1e-6, "µs")) if middle * s * _SLOWEST <= 1), (1e-9, "ns"))
    return scale, f"no unit; {1 / middle:.3g} Hz, if it were in s, levitates nothing: taken as {name}", "unit of time"


def jitter_of(time: np.ndarray) -> float:
    """rms of the steps of a column of time (samples,) about their median, as a share of it; of usual steps alone."""
    steps = np.diff(time)
    middle = np.median(steps)
    if not middle > 0:  # stamps of a coarse clock, which tell none
        return 0.0
    return float(np.std(steps[np.abs(steps - middle) < 0.5 * middle]) / middle)


def _unsure(steps: np.ndarray) -> float:
    """Relative standard error of the mean of steps (n,), by blocks: of stamps that are only rounded it is small."""
    blocks = np.array_split(steps, _BLOCKS)
    if blocks[-1].size == 0:
        return 0.0
    means = np.array([block.mean() for block in blocks])
    return float(means.std(ddof=1) / np.sqrt(_BLOCKS) / means.mean())


def _nice(rate: float, within: float = 0.0) -> float:
    """The roundest number within a relative deviation, where one is near enough; else the rate."""
    for digits in (1, 2, 3, 4):
        rounded = float(f"{rate:.{digits}g}")
        if abs(rounded / rate - 1) < max(_ROUND, min(within, _MOST_ROUND)):
            return rounded
    return rate
