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
# Probability that noise alone is taken for distortion: what it then adds is small, and distortion that is missed leaves
# intervals too narrow.
BY_CHANCE = 1e-3
FEWEST = 2.0  # lines of a record that the curves must leave, so that it tells its own distortion
LEAST_FREEDOM = 5.0  # of an estimate of noise, so that a variance of what it divides exists


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
    noise = error @ lines.own @ np.conj(np.swapaxes(error, -1, -2))
    level = lines.per_record(np.diagonal(noise, axis1=-2, axis2=-1).real)  # of the force, (lanes, records, 2)
    # Coefficients that bend over the band explain what is in proportion to the motion, times a smooth curve.
    curves = np.vander(lines.w / lines.w.mean() - 1, BENT)
    motion = (lines.u[:, :, 2:, None] * curves[:, None]).reshape(len(masses), lines.w.size, 2 * BENT)
    parts = [_beside(lines, motion, left[..., axis], level[..., axis]) for axis in range(2)]
    rest, spare, joint = (np.stack(part, axis=1) for part in zip(*parts, strict=True))  # (lanes, 2, records, ...)
    bent = rest.sum((1, 2)) > _highest(lines, noise, spare, joint)
    level, spare = np.swapaxes(level, 1, 2)[bent], spare[bent]
    more = (rest[bent] - spare) * level
    # A record whose few lines those curves explain nearly all tells nothing of its own: what all show counts.
    shown = np.where(spare < FEWEST, more.sum(-1, keepdims=True), more)
    of = np.where(spare < FEWEST, spare.sum(-1, keepdims=True), spare)
    power = np.maximum(shown / of, 0.0)  # of the force, (lanes, 2, records)
    moves = np.linalg.inv(-error[bent][..., 2:]) * np.sqrt(np.swapaxes(power, 1, 2))[:, lines.record, None, :]
    own = lines.own[bent]
    own[..., 2:, 2:] += moves @ np.conj(np.swapaxes(moves, -1, -2))
    share = np.zeros(len(masses))
    share[bent] = (power / (level + power)).max((1, 2))
    return replace(lines, u=lines.u[bent], own=own), share


def _beside(
    lines: PlanarLines, motion: np.ndarray, left: np.ndarray, level: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What curves do not explain of one equation's errors.

    Args:
        lines: Of one band.
        motion: What the curves multiply, (lanes, n, columns).
        left: Errors (lanes, n).
        level: Noise of each record (lanes, records).

    Returns:
        rest: Power beside the curves over that of the noise, (lanes, records), of which noise alone makes `spare`.
        spare: Lines of each record that the curves leave (lanes, records); in all, n less the number of columns.
        joint: Covariances of `rest` (lanes, records, records) for a noise whose level is known.
    """
    scale = 1 / np.sqrt(level[:, lines.record])
    basis, white = np.linalg.qr(motion * scale[..., None])[0], left * scale
    explained = basis @ (np.conj(np.swapaxes(basis, -1, -2)) @ white[..., None])
    power = np.abs(white - explained[..., 0]) ** 2
    count = np.bincount(lines.record)
    own = [basis[:, lines.record == r] for r in range(count.size)]
    gram = np.stack([np.conj(np.swapaxes(q, -1, -2)) @ q for q in own], axis=1)
    taken = np.einsum("lrii->lr", gram).real
    joint = np.einsum("lrij,lsji->lrs", gram, gram).real + np.eye(count.size) * (count - 2 * taken)[:, None]
    return lines.per_record(power) * count, count - taken, joint


def _highest(lines: PlanarLines, noise: np.ndarray, spare: np.ndarray, joint: np.ndarray) -> np.ndarray:
    """What noise alone makes of the sum of `rest` but for the probability `BY_CHANCE`, (lanes,).

    Records of few lines know their noise less well than others, and the sum divides by it. It is approximated by an F
    distribution of the same mean and variance.

    Args:
        lines: Of one band.
        noise: Of the force at each line (lanes, n, 2, 2).
        spare: As from `_beside`, of both equations (lanes, 2, records).
        joint: Likewise (lanes, 2, records, records).
    """
    if lines.w.size <= 2 * BENT:
        return np.full(len(noise), np.inf)
    count = np.bincount(lines.record)
    own = np.diagonal(noise, axis1=-2, axis2=-1).real
    square = lines.per_record(own**2) * ((lines.periods - 1) / lines.periods)[:, None]
    alike = np.swapaxes(np.minimum(lines.per_record(own) ** 2 / square, 1.0), 1, 2)  # of unequal noise fewer count
    # Mean and variance of the true noise over its estimate, chi-squared with so many degrees of freedom.
    freedom = np.maximum(2 * alike * count * (lines.periods - 1), LEAST_FREEDOM)
    mean = freedom / (freedom - 2)
    variance = 2 * mean**2 / (freedom - 4)
    both = mean[..., None] * mean[..., None, :] + np.eye(count.size) * variance[..., None]
    # Both equations scatter together as far as their noise does.
    level = lines.per_record(noise)
    together = 1 + np.abs(level[..., 0, 1]) ** 2 / (level[..., 0, 0] * level[..., 1, 1]).real
    unequal = np.sqrt(together[:, None] / alike)
    joint = joint * unequal[..., None] * unequal[..., None, :]
    variance = variance * together[:, None]
    upper = 2 * spare.sum((1, 2)) ** 2 / joint.sum((1, 2, 3))
    expected = (spare * mean).sum((1, 2))
    scatter = ((joint * both).sum((1, 2, 3)) + (spare**2 * variance).sum((1, 2))) / expected**2 * upper
    lower = (2 * upper - 4 + 4 * scatter) / (scatter - 2)
    ratio = scipy.special.fdtri(upper, lower, 1 - BY_CHANCE)
    return np.asarray(expected * (lower - 2) / lower * ratio)
