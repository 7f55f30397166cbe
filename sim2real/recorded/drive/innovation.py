"""What of a measured drive its past does not explain: an instrument where nothing is recorded of what drove a loop.

The current (or command) u of a rig whose controller is not known is regressed on the past of currents and readings.
What is left, the innovation, is what was newly added to the loop: a step of the set point, an injection, the rounding
of the converter. What the controller makes of sensor noise is explained by the readings, in which the noise stands. So
the innovation is free of that noise, and an instrument as a recorded reference is (a joint input-output method:
Forssell and Ljung, Automatica 35, 1999; Soderstrom and Stoica, System Identification, 1989, chapter 10). Nothing need
be known of the controller, but every reading that it used must be in the regression: a current that is read after the
controller has answered to the latest reading follows that one too, which its correlation with what is new in the
reading tells.

The meter's own noise is in the innovation and in the drive. What it pretends is taken off, and an innovation that is
little more than that noise is no instrument.

A log that is not what the controller read has noise of its own. The regression takes it into the innovation, while the
current is free of it. Which share of the reading's noise the controller saw is not stated, so half of what all of it
would pretend is taken off, and all of it remains as a standard deviation.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.fft

from estimation.lines.line_windows import NOISE_ALONE
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import axis_rig
from sim2real.recorded.drive.instrument import compared_along
from sim2real.recorded.nominal import nominal_blocks
from sim2real.recorded.open_record import OpenRecord

TAPS = 24  # past samples of the regression
ROWS_PER_TAP = 20  # samples for each of them, at least
LOUD = 5.0  # power of an innovation over that of the meter's noise, from which it is an instrument
# Share of the reading's noise that the controller did not see, and its standard deviation: so wide that the record says
# by itself whether that is nothing or all.
OWN, OWN_SPREAD = 0.5, 1.0
UNSURE = 1.0  # share of the meter's bias that remains as a standard deviation: its noise is stated, not measured
CLEAR = 4.0  # standard errors by which the latest reading must show in the current to count as used


def along_innovations(record: OpenRecord, channels: Mapping[str, np.ndarray], top: float) -> OpenRecord | None:
    """The record, compared only along the innovations of its drive; None where they do not clearly move the rotor.

    Args:
        record: driven by its measured current or command, as it was read: no low-pass or delay has been undone.
        channels: channel -> (axes, samples) of the simulated part.
        top: highest frequency that is compared, Hz.
    """
    drive, reading = channels[record.source], channels["displacement"]
    taps = min(TAPS, drive.shape[1] // (ROWS_PER_TAP * 2 * len(drive)))
    if not taps:
        return None
    latest = record.source == "command" or _late(record, drive, reading, taps)
    found, past, answer = innovations(drive, reading, taps, latest)
    noise = record.nominal.noise.current**2 or _floor(drive) if record.source == "current" else 0.0
    if record.slower_than_controller:
        # What the controller did between the samples is folded into them, and no noise that a rig states includes it.
        noise = max(noise, _floor(drive))
    if not (np.mean(found**2, axis=1) > LOUD * noise).all():
        return None
    along = compared_along(record, found, top)
    if along is None:
        return None
    of_log = _of_log(along, found, answer, reading, latest)
    bias, unsure = OWN * of_log, {"own noise of the logged displacement": OWN_SPREAD * of_log}
    if noise:
        of_meter = _of_meter(along, found, past, noise)
        bias, unsure = bias + of_meter, {**unsure, f"noise in the drive of {record.name}": UNSURE * of_meter}
    return replace(along, bias=bias, unsure=unsure)


def innovations(
    drive: np.ndarray, reading: np.ndarray, taps: int, latest: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Innovations (axes, samples) of a drive, zero at first; and the weights (axes, ages) of its own past and of the
    readings of its axis.

    Args:
        drive: (axes, samples), A.
        reading: (axes, samples), m.
        taps: past samples of each that are used.
        latest: whether the reading of the same sample is used too.
    """
    own = _past(drive, taps, 1)
    columns = np.concatenate([own, _past(reading, taps, 0 if latest else 1)])
    found, weights = _left(drive, columns, taps)
    axes, ages = len(drive), taps + latest
    own, answer = weights[:, : axes * taps], weights[:, axes * taps :]
    return (
        found,
        np.array([own[axis, axis * taps : (axis + 1) * taps] for axis in range(axes)]),
        np.array([answer[axis, axis * ages : (axis + 1) * ages] for axis in range(axes)]),
    )


def _past(series: np.ndarray, taps: int, first: int) -> np.ndarray:
    """Series (axes, samples) that are first .. taps samples old, (axes * ages, samples - taps)."""
    n = series.shape[1] - taps
    return np.array([s[taps - age : taps - age + n] - s.mean() for s in series for age in range(first, taps + 1)])


def _left(series: np.ndarray, columns: np.ndarray, taps: int) -> tuple[np.ndarray, np.ndarray]:
    """What columns (columns, samples - taps) leave of series (axes, samples), and their weights (axes, columns)."""
    scale = np.maximum(abs(columns).max(axis=1), 1e-300)
    target = series[:, taps:] - series.mean(axis=1, keepdims=True)
    weights = np.linalg.lstsq((columns / scale[:, None]).T, target.T, rcond=1e-10)[0].T / scale
    left = np.zeros_like(series)
    left[:, taps:] = target - weights @ columns
    return left, weights


def _late(record: OpenRecord, drive: np.ndarray, reading: np.ndarray, taps: int) -> bool:
    """Whether the current follows the reading of its own sample, that is, was read after the controller's answer.

    A controller that holds the rotor answers to what is new in a reading with the opposite sign; a current that was
    read together with it can move the rotor only in its own direction.
    """
    new, *_ = innovations(drive, reading, taps, False)
    columns = np.concatenate([_past(drive, taps, 1), _past(reading, taps, 1)])
    seen, _ = _left(reading, columns, taps)
    for axis, (e, v) in enumerate(zip(new[:, taps:], seen[:, taps:], strict=True)):
        toward = np.sign(linearise(force_law(axis_rig(record.nominal, axis)))[0])
        spread = np.linalg.norm(e) * np.linalg.norm(v) / np.sqrt(e.size)
        if toward * float(e @ v) < -CLEAR * spread:
            return True
    return False


def _floor(series: np.ndarray) -> float:
    """Mean square of white noise that explains series (axes, samples) at their highest frequencies."""
    samples = series.shape[1]
    lines = slice(*(int(share * samples) for share in NOISE_ALONE))
    spectrum = np.asarray(scipy.fft.rfft(series - series.mean(axis=1, keepdims=True)))[:, lines]
    return float(np.mean(abs(spectrum) ** 2) / samples)


def _of_meter(record: OpenRecord, found: np.ndarray, past: np.ndarray, noise: float) -> np.ndarray:
    """What the meter's noise (mean square, A^2), which is in drive and innovation, adds to the opened displacement,
    (axes, n)."""
    frequency = record.windows.frequency
    kept = 1 - _response(past, 1, record)
    plant = nominal_blocks(record.experiment, frequency.ravel(), False)[2]
    return _pretended(record, found, -np.reshape(plant, kept.shape) * np.conj(kept) * noise)


def _of_log(record: OpenRecord, found: np.ndarray, answer: np.ndarray, reading: np.ndarray, latest: bool) -> np.ndarray:
    """What all noise of the readings (axes, samples), if the controller saw none of it, adds to the opened
    displacement, (axes, n)."""
    return _pretended(record, found, -np.conj(_response(answer, 1 - latest, record)) * _floor(reading))


def _response(weights: np.ndarray, first: int, record: OpenRecord) -> np.ndarray:
    """Responses (axes, windows, WIDTH) of weights (axes, ages) of samples that are `first` and more samples old."""
    z = np.exp(2j * np.pi * record.windows.frequency / record.windows.sample_rate)
    return np.moveaxis(z[..., None] ** -np.arange(first, first + weights.shape[1]) @ weights.T, -1, 0)


def _pretended(record: OpenRecord, found: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Coordinates (axes, n) along innovations (axes, samples) of a spectrum that shares noise with them.

    Args:
        shared: covariance (axes, windows, WIDTH) of the spectrum with the innovation's, of a sample: m A.
    """
    own = record.spectrum(found)
    power = np.mean(abs(own) ** 2, axis=-1, keepdims=True)
    line = 4 / record.windows.samples  # mean square of white noise's amplitude on a line, over that of a sample
    bias = record.windows.project(own * line * shared / np.maximum(power, 1e-300))
    return bias.reshape(*bias.shape[:-2], -1)
