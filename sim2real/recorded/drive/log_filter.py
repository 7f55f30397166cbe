"""The low-pass in front of a log that is slower than its controller, told from the noise of the logged displacement.

A log of its own rate passes an anti-aliasing filter of which nobody states anything. It smooths current and
displacement alike, so a linear rig does not show it; the pull of a large motion, by squares of both, does. Above what
the motion reaches the displacement is noise alone, and white noise of the sensor falls there as the filter does.
"""

from collections.abc import Mapping
from math import pi

import numpy as np
import scipy.optimize
import scipy.signal

from maglev_env.recordings.left_out import TellsNothing
from maglev_env.rig.rig import axis_rig
from sim2real.recorded.drive.instrument import varying
from sim2real.recorded.open_record import OpenRecord

SEGMENT = 512  # samples of a segment; the median of all is taken, because a chirp's harmonics are in few of them
LEAST = 12  # frequencies of noise alone from which a filter is told
# Noise alone begins at this multiple of the frequency below which all but this share of the power of what drives lies:
# harmonics are in few segments.
ABOVE, BEYOND = 1.5, 1e-3
TOP = 0.47  # of the rate: highest frequency that is looked at
POLES, CORNERS = (1, 2, 3, 4, 6, 8), np.geomspace(0.01, 0.5, 60)  # of filters that are tried; the corners of the rate
UNSURE = 1.5  # standard deviation of the logarithm of the noise's density below the corner, as the rig states it
WEIGHED = 0.1  # share of the frequencies whose deviations are independent
FALLS = 3.0  # least fall of the noise that counts as that of a filter
BETTER = 4.0  # least ratio of what white noise leaves to what a filter leaves, both squares of logarithms
CLEAR_OF = 1.5  # times the highest frequency of what drives a large motion: least corner
WITHIN = 0.6  # of the corner: up to there terms of low order undo a filter
# Largest term of each order of what undoes a low-pass of corner 1 rad/s and is left beside its delay, of one to eight
# Butterworth poles. The first is that of one pole.
TERMS = {2: 0.5, 3: 0.5, 4: 0.5}


def corner_of_log(record: OpenRecord, channels: Mapping[str, np.ndarray]) -> float | None:
    """Corner (Hz) of the low-pass that the noise of a log shows, the lowest of its axes; None where none shows.

    Args:
        record: a recording.
        channels: channel -> (axes, samples) of the simulated part.

    Raises:
        TellsNothing: a motion that is large for its magnets reaches up to the corner.
    """
    known = varying(channels, record.first)
    if not record.slower_than_controller or not len(known):
        return None  # a log of what the controller itself read has no filter of its own
    w, found = record.windows, []
    part = slice(record.first, record.first + w.samples)
    power = np.cumsum(abs(np.fft.rfft(known[:, part] - known[:, part].mean(axis=1, keepdims=True))) ** 2, axis=1)
    moved = float(max(np.searchsorted(p, (1 - BEYOND) * p[-1]) for p in power)) / w.samples
    for axis, series in enumerate(record.series["displacement"][:, part]):
        rig = axis_rig(record.nominal, axis)
        level = 2 * rig.noise.displacement**2 * w.sample_rate / rig.control_rate
        if (corner := log_corner(series, ABOVE * moved, level)) is not None:
            found.append(corner * w.sample_rate)
    corner = min(found, default=None)
    if corner is not None and record.along is not None and corner < CLEAR_OF * moved * w.sample_rate:
        raise TellsNothing(
            f"its noise shows that the log is low-passed at about {corner:.2g} Hz, and what drives the loop reaches to "
            f"{moved * w.sample_rate:.2g} Hz: peaks of the current that pull a moving rotor most are not in it",
            "state that filter with each channel, log with a higher corner, or move the rotor less",
        )
    return corner


def smoothing(record: OpenRecord, usual: Mapping[int, float], corner: float | None) -> dict[int, float]:
    """Order -> standard deviation (s^order) of the terms of what undoes the filter of a log; none where it has none.

    Args:
        record: a recording.
        usual: those that are not told, in samples to that power.
        corner: as `corner_of_log` tells it, Hz.
    """
    if not record.slower_than_controller:
        return {}
    told = {} if corner is None else {order: size / (2 * pi * corner) ** order for order, size in TERMS.items()}
    step = 1 / record.windows.sample_rate
    return {order: max(size * step**order, told.get(order, 0.0)) for order, size in usual.items()}


def in_words(corner: float | None, top: float, usual: float) -> tuple[str, ...]:
    """What is said of a log whose filter of this corner leaves less to compare, up to `top`, than is usual, Hz."""
    if corner is None or top >= usual:
        return ()
    return (
        f"the noise of the displacement shows that the log is low-passed at about {corner:.2g} Hz: only up to "
        f"{top:.2g} Hz is compared; state it as filter of the channels, or log with a higher corner",
    )


def log_corner(series: np.ndarray, moved: float, level: float) -> float | None:
    """Corner, in cycles per sample, of the low-pass that the noise of a log (samples,) shows; None where none shows.

    Args:
        series: displacement, m.
        moved: cycles per sample up to which it is motion.
        level: density of the noise below the corner as it is stated, m^2 per cycle per sample; 0: it is not.
    """
    segment = min(SEGMENT, series.size // 4)
    frequency, power = scipy.signal.welch(series, nperseg=segment, detrend="linear", average="median")
    alone = (frequency > moved) & (frequency < TOP)
    if alone.sum() < LEAST or not (power[alone] > 0).all():
        return None
    f, p = frequency[alone], power[alone]
    lowest, highest = np.median(p[: LEAST // 3]), np.median(p[-LEAST // 3 :])
    if lowest < FALLS * highest:
        return None
    level = level or lowest
    least, corner = np.inf, None
    for poles in POLES:
        for at in CORNERS:
            columns = np.stack([1 / (1 + (f / at) ** (2 * poles)), np.ones_like(f)], axis=1)
            shares, _ = scipy.optimize.nnls(columns / p[:, None], np.ones_like(f))  # of the filtered and of a floor
            if shares[0] <= 0:
                continue
            left = float(np.sum(np.log(p / (columns @ shares)) ** 2))
            left += WEIGHED * f.size * (np.log(shares[0] / level) / UNSURE) ** 2
            if left < least:
                least, corner = left, float(at)
    white = float(np.sum((np.log(p) - np.mean(np.log(p))) ** 2))
    return corner if white > BETTER * least else None
