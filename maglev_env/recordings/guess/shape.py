"""The kind of a signal that does not repeat, in words: steps, a chirp, noise, or rest."""

import numpy as np
import scipy

from maglev_env.recordings.guess.behaviour import correlation, steps_in

_SEGMENTS = 24, 96  # in which a slow and a fast chirp are one tone each
_NARROW = 0.5  # share of a segment's power near its strongest bin that makes it one tone
_BROAD = 0.05  # flatness of a spectrum that makes it noise
_BLOWS, _LEAST_BLOW = 0.1, 3  # share of the samples that blows of a hammer take, and samples of one, on average
_REST = 0.02  # rms of the second half over that of the first, or the reverse, of a signal that only settles


def shape_of(values: np.ndarray, rate: float | None) -> tuple[str, str]:
    """The kind of an aperiodic signal.

    Args:
        values: the signal (samples,).
        rate: its sample rate, Hz; None where it is not known.

    Returns:
        One of "constant", "blows", "steps", "chirp", "noise", "other", and the evidence in words.
    """
    if values.min() == values.max():
        return "constant", f"{values[0]:g} in every sample"
    if count := blows_in(values):
        return "blows", f"{count} pulses, and {np.median(values):.3g} between them"
    if count := steps_in(values):
        levels = np.unique(values).size
        return "steps", f"{count} changes between {levels} levels, constant between them"
    unit = "Hz" if rate else "cycles a sample"
    moved = (values - values.mean(), rate or 1.0)
    for segments in _SEGMENTS:
        frequency, power = _segments(*moved, max(16, values.size // segments))
        strongest = power.argmax(axis=0)
        near = np.abs(np.arange(len(frequency))[:, None] - strongest) <= 2
        tonal = (power * near).sum(axis=0) / np.maximum(power.sum(axis=0), 1e-300)
        track = frequency[strongest]
        trend = correlation(track, np.arange(track.size, dtype=float))
        if np.median(tonal) > _NARROW and abs(trend) > 0.85 and track.max() > 2 * max(track.min(), frequency[1]):
            return "chirp", f"one tone that moves from {track[0]:.3g} to {track[-1]:.3g} {unit}"
    mean = _segments(*moved, max(16, values.size // _SEGMENTS[0]))[1].mean(axis=1)[1:]
    flat = float(np.exp(np.mean(np.log(np.maximum(mean, 1e-300)))) / mean.mean())
    if flat > _BROAD:
        return "noise", f"broad-band (spectral flatness {flat:.2f})"
    return "other", f"neither steps nor a chirp nor broad-band (spectral flatness {flat:.2g})"


def _segments(values: np.ndarray, rate: float, length: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (n,) and power (n, segments) of segments that follow each other."""
    frequency, _, power = scipy.signal.spectrogram(values, rate, nperseg=length, noverlap=0, detrend="constant")
    return frequency, power


def blows_in(values: np.ndarray) -> int:
    """Number of short pulses of a signal (samples,) that rests otherwise; 0 where it is none."""
    off = values != np.median(values)
    begins = np.flatnonzero(np.diff(off.astype(int)) > 0)
    if not begins.size or off.mean() > _BLOWS or off.sum() < _LEAST_BLOW * begins.size:
        return 0
    return int(begins.size)
