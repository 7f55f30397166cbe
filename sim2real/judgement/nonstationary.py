"""Whether the noise that a fit leaves is as white in time as its intervals assume.

A kick of the derivative, a step into saturation or a slipping friction leaves errors at single moments. They are
coherent over all lines, so that local noise estimates do not see them, and intervals come out too narrow. What allows
for this is the covariance with the scores s summed over blocks of time: sum s s^T in place of J^T J (the "sandwich" of
White, Econometrica 50, 1982, clustered by blocks).
"""

from collections.abc import Sequence

import numpy as np
import scipy.fft

from estimation.lines.line_windows import KEPT, WIDTH
from sim2real.compared.problem import Part, Problem
from sim2real.recorded.open_record import OpenRecord
from sim2real.search.fit import Fit

BLOCKS = 40
SIGNIFICANT = 3.0  # standard deviations by which the ratio of the variances must exceed 1
LEAST = 4.0  # effective blocks below which nothing can be told


def widening(problem: Problem, fit: Fit) -> np.ndarray:
    """Factors (size,), at least 1, on the standard errors of a fit.

    Args:
        problem: what was fitted; recordings with a period count as stationary.
        fit: with its Jacobian.
    """
    toward = fit.covariance() @ fit.jacobian  # what each residual adds to each coordinate
    return np.sqrt(whiteness(problem.parts, toward, fit.residual, [p.place for p in problem.parts]))


def whiteness(parts: Sequence[Part], toward: np.ndarray, residual: np.ndarray, places: Sequence[slice]) -> np.ndarray:
    """Factors (size,), at least 1, on the variances of linear estimates.

    Args:
        parts: of the recordings.
        toward: (size, K), what each whitened residual adds to each estimate, conjugate.
        residual: (K,), whitened.
        places: of the parts in these.
    """
    white, beyond, shares = np.sum(abs(toward) ** 2, axis=1), np.zeros(len(toward)), np.zeros(len(toward))
    for part, place in zip(parts, places, strict=True):
        if isinstance(part.record, OpenRecord):
            scores, weights = _scores(part, toward[:, place], residual[place])
            beyond += np.sum(scores**2 - weights, axis=1)
            shares += np.sum(weights**2, axis=1)
    told = (white > 0) & (shares > 0)  # not an estimate to which no recording without a period adds anything
    ratio = 1 + np.divide(beyond, white, out=np.zeros_like(white), where=told)
    blocks = np.divide(white**2, shares, out=np.zeros_like(white), where=told)
    surely = (ratio > 1 + SIGNIFICANT * np.sqrt(2 / np.maximum(blocks, 1.0))) & (blocks > LEAST)
    return np.where(surely, np.maximum(ratio, 1.0), 1.0)


def _scores(part: Part, toward: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scores (size, BLOCKS) of blocks of time, and their variances under white noise."""
    e, columns = _in_time(part, residual[None]), _in_time(part, toward)
    split = np.array_split(np.arange(e.shape[-1]), BLOCKS)
    scores = np.stack([np.einsum("ict,ct->i", columns[..., at], e[0][..., at]) for at in split], axis=1)
    weights = np.stack([np.einsum("ict,ict->i", columns[..., at], columns[..., at]) for at in split], axis=1)
    return scores, weights


def _in_time(part: Part, coordinates: np.ndarray) -> np.ndarray:
    """Whitened coordinates (n, K) as series (n, outputs * axes, samples); their products sum to those of the lines."""
    record = part.record
    whole = np.zeros((len(coordinates), *part.measured.shape), complex)
    count = int(part.used.sum())
    whole[..., part.used] = coordinates.reshape(len(coordinates), *part.measured.shape[:2], count)
    w = record.windows
    lines = w.lines(whole.reshape(*whole.shape[:-1], w.count, KEPT))
    spectrum = np.zeros((*lines.shape[:-2], w.samples // 2 + 1), complex)
    spectrum[..., w.first : w.first + w.count * WIDTH] = lines.reshape(*lines.shape[:-2], w.count * WIDTH)
    series = np.asarray(scipy.fft.irfft(spectrum, w.samples, axis=-1)) * np.sqrt(w.samples / 2)
    return series.reshape(len(coordinates), int(np.prod(part.measured.shape[:2])), w.samples)
