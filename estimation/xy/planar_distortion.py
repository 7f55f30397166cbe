"""Stochastic nonlinear distortion in the lines of two coupled axes.

What the law of a magnet bends repeats with the period, but differs from line to line as noise does (Pintelon and
Schoukens 2012, ch. 4). What the equations' errors scatter more than the noise, beside coefficients that bend over the
band, is a force that is not recorded, and counts as noise of the displacement that it moves (see `band_mean`).
"""

from dataclasses import replace

import numpy as np
import scipy

from estimation.xy.planar_lines import PlanarLines, equation_rows

BENT = 5  # coefficients of a curve of stiffness and damping over a band
BY_CHANCE = 1e-4  # probability that noise alone is taken for distortion


def distorted(lines: PlanarLines, masses: np.ndarray, coefficients: np.ndarray) -> tuple[PlanarLines, np.ndarray]:
    """What the equations' errors scatter although the coefficients may bend, as noise of the displacement.

    Args:
        lines: Of one band.
        masses: (lanes, 2), kg.
        coefficients: (lanes, 8).

    Returns:
        lines: Of the lanes that scatter by surely more than the noise, with that as noise.
        share: Largest share of distortion in that noise (lanes,); 0 in the other lanes.
    """
    rows = equation_rows(lines, masses)
    k, c = (coefficients[:, part].reshape(-1, 1, 2, 2) for part in (slice(4), slice(4, 8)))
    error = rows[:, :, 4:] - k @ rows[:, :, :2] - c @ rows[:, :, 2:4]
    left = (error @ lines.u[..., None])[..., 0]
    noise = error @ lines.per_record(lines.own)[:, lines.record] @ np.conj(np.swapaxes(error, -1, -2))
    noise = lines.per_record(np.diagonal(noise, axis1=-2, axis2=-1).real)  # of the force, (lanes, records, 2)
    # Coefficients that bend over the band explain what is in proportion to the motion, times a smooth curve.
    curves = np.vander(lines.w / lines.w.mean() - 1, BENT)
    motion = (lines.u[:, :, 2:, None] * curves[:, None]).reshape(len(masses), lines.w.size, 2 * BENT)
    ratio = np.empty_like(noise)
    for axis in range(2):
        level = np.sqrt(noise[:, lines.record, axis, None])
        basis, white = np.linalg.qr(motion / level)[0], left[..., axis, None] / level
        rest = np.abs(white - basis @ (np.conj(np.swapaxes(basis, -1, -2)) @ white))[..., 0] ** 2
        spare = lines.per_record(1 - (np.abs(basis) ** 2).sum(axis=-1))
        ratio[..., axis] = lines.per_record(rest) / np.maximum(spare, 1e-6)
    count = lines.w.size - 2 * BENT
    measured = 4 * (np.bincount(lines.record) * (lines.periods - 1)).sum()
    level = scipy.special.fdtri(4 * count, measured, 1 - BY_CHANCE) if count > 0 else np.inf
    bent = ratio.mean((1, 2)) > level
    excess = np.maximum(ratio - 1, 0.0)[bent]
    moves = np.linalg.inv(-error[bent][..., 2:]) * np.sqrt(excess * noise[bent])[:, lines.record, None, :]
    more = lines.own[bent]
    more[..., 2:, 2:] += moves @ np.conj(np.swapaxes(moves, -1, -2))
    share = np.zeros(len(masses))
    share[bent] = (excess / (1 + excess)).max((1, 2))
    return replace(lines, u=lines.u[bent], own=more), share
