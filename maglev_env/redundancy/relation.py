"""A channel and what others make of it, by least squares of their spectra."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Relation:
    """A channel, and what it is made of: mean spectra (n,) by channel; the variance (n,) of its mean.

    `beside`: what else may be in the channel, with any gain, (n,).
    """

    name: str
    out: np.ndarray
    made: Mapping[str, np.ndarray]
    variance: np.ndarray
    against: str
    beside: tuple[np.ndarray, ...] = ()


def of_gain(size: float, error: float, gain: float) -> tuple[float, float]:
    """What a channel lacks and its error, where it enters with a gain, which is not 1 behind a wrong scale or sign."""
    return (size / gain, error / abs(gain)) if gain else (0.0, error)


def squares(out: np.ndarray, parts: list[np.ndarray], weight: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Least squares of spectra with real coefficients: these, the cost that is left, and the error of the last one."""
    root = np.sqrt(weight)
    columns = np.stack(parts) * root
    scale = np.maximum(np.linalg.norm(columns, axis=1), 1e-300)
    real = np.concatenate([columns.real, columns.imag], axis=1) / scale[:, None]
    wanted = np.concatenate([(out * root).real, (out * root).imag])
    found, *_ = np.linalg.lstsq(real.T, wanted, rcond=None)
    left = float(((wanted - found @ real) ** 2).sum())
    error = np.sqrt(max(np.linalg.pinv(real @ real.T)[-1, -1], 0.0) * max(left / wanted.size, 0.5))
    return found / scale, left, float(error / scale[-1])
