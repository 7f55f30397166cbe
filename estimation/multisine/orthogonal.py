"""Multisines for several inputs at once: orthogonal over as many experiments, or interleaved in one record.

Orthogonal multisines follow Dobrowiecki, Schoukens and Guillaume (IEEE Trans. Instrum. Meas. 55, 2006) and Pintelon
and Schoukens (System Identification, 2nd ed., 2012, ch. 2 and 3).
"""

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from estimation.multisine.sphs import Multisine


def orthogonal_multisines(multisine: Multisine, axes: int = 2) -> tuple[tuple[Multisine, ...], ...]:
    """Inputs of `axes` experiments that drive every axis on every line; for two axes, (s, s) and (s, -s).

    On each line the matrix U (axes, experiments) of complex inputs is sqrt(axes) |amplitude| times a unitary matrix.
    Its condition number is therefore 1, and each entry of the response Y U^-1 has 1 / axes of the variance that it
    would have if every experiment drove one axis. For 1, 2, 4, 8 ... axes the unitary matrix is a Hadamard matrix,
    whose signs keep the peak. For other numbers it is the DFT matrix, whose phase shifts raise the peak of
    `low_crest` up to twofold and that of `sphs` by a factor of about 1.15; then scale by the peak of `synthesise`.

    Args:
        multisine: The signal s of one axis.
        axes: Number of axes.

    Returns:
        Multisines, indexed [experiment][axis].

    Raises:
        ValueError: axes < 1.
    """
    if axes < 1:
        raise ValueError("axes must be at least 1")
    if axes & (axes - 1) == 0:
        shifts = np.angle(scipy.linalg.hadamard(axes))
    else:
        shifts = 2 * np.pi / axes * np.outer(np.arange(axes), np.arange(axes))
    return tuple(
        tuple(Multisine(multisine.lines, multisine.amplitudes, multisine.phases + shift) for shift in experiment)
        for experiment in shifts
    )


def interleaved_lines(lines: ArrayLike, axes: int = 2) -> tuple[NDArray[np.int64], ...]:
    """Lines dealt out to the axes in turn, so that one record drives each axis on lines of its own.

    The numbers of lines of the axes differ by one at most, each axis covers the whole band at `axes` times the
    spacing, and odd lines stay odd. The response to an axis is then known on that axis's lines only.

    Args:
        lines: Strictly increasing harmonic numbers (n,).
        axes: Number of axes.

    Returns:
        One array of lines per axis.

    Raises:
        ValueError: Unless 1 <= axes <= n and the lines increase strictly from 1 or above.
    """
    values = np.array(lines)
    if values.ndim != 1 or not np.issubdtype(values.dtype, np.integer):
        raise ValueError("lines must be a one-dimensional sequence of integer harmonic numbers")
    if np.any(values < 1) or np.any(np.diff(values) <= 0):
        raise ValueError("lines must increase strictly and start at 1 or above")
    if not 1 <= axes <= values.size:
        raise ValueError(f"axes must lie between 1 and the number of lines, {values.size}; take more lines")
    return tuple(values[axis::axes].astype(np.int64) for axis in range(axes))
