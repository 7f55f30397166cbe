"""Mean and range of stiffness and damping over a band in which they are not constant.

The fit of constants lies somewhere inside the range of k(f), where the noise of the lines puts its weight, and its
interval speaks of the noise alone. Here k and c are parabolas over the band, so that their means do not depend on the
weights, and what the parabolas leave widens the interval: stochastic nonlinear distortion differs from line to line as
noise does, but repeats with the period (Pintelon and Schoukens 2012, ch. 4). It is in the motion, not in the force that
causes it, and is added to the noise of the displacement: errors of a regressor that count as errors of the force would
pull the stiffness toward m w^2.

Distortion is not independent between lines. A force that depends on the displacement y has a potential, of a cubic one
y^4, in which lines come in fours: the product of four amplitudes whose frequencies add up to nothing is the work at
each of the four. It moves the apparent stiffness of all four alike, and their damping so that the sum is zero. The
mean stiffness of a band that holds all of the motion is therefore four times as uncertain, in variance, as its lines
show, and that of one with a share p of the motion's power about 1 + 3 p times.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.polynomial.legendre import legval, legvander

from estimation.bands import band_slices
from estimation.lines.periods import LineStatistics
from estimation.normal import NOISELESS, reach, variance_of_difference

DEGREE = 2
SPARE = 4  # lines beyond one for each coefficient of k, so that what is left tells the distortion
ROUNDS = 4  # in which the size of the distortion is found
ENOUGH = 0.05  # of the residual power, to which the distortion must explain it
PARTNERS = 3  # lines that distortion moves together with one
GRID = np.linspace(-1.0, 1.0, 21)  # where the range is read


@dataclass(frozen=True)
class BandMean:
    """Mean of a coefficient over a band, N/m or N s/m.

    Attributes:
        value: the mean.
        se: its standard error.
        low: 95 % bound of the mean.
        high: 95 % bound of the mean.
        range: least and largest value of the fitted curve inside the band; None where constants were fitted.
    """

    value: float
    se: float
    low: float
    high: float
    range: tuple[float, float] | None


def band_mean(
    statistics: LineStatistics, band: np.ndarray, mass: float, start: tuple[float, float], level: float = 0.95
) -> tuple[BandMean, BandMean]:
    """Means of stiffness and damping over one band, by the errors-in-variables cost of `maximum_likelihood`.

    Args:
        statistics: channels "force" and "displacement" at the force lines, without leading dimensions.
        band: (2,), Hz.
        mass: moving mass, kg.
        start: stiffness, N/m, and damping, N s/m, of the fit of constants.
        level: confidence level.
    """
    ((first, stop),) = band_slices(statistics.frequency, band[None])
    f = statistics.frequency[first:stop]
    force, moved = (statistics.amplitude(name)[first:stop] for name in ("force", "displacement"))
    floor = NOISELESS * np.mean(abs(force) ** 2)
    sff, syy = (statistics.cross(n, n)[first:stop].mean() for n in ("force", "displacement"))
    sfy = statistics.cross("force", "displacement")[first:stop].mean()
    w = 2 * np.pi * f
    degree = int(np.clip(f.size - SPARE, 0, DEGREE))
    shape = legvander((2 * f - band.sum()) / (band[1] - band[0]), degree)
    size = np.array([abs(start[0]) + mass * w.mean() ** 2, abs(start[0]) / w.mean() + mass * w.mean()])
    size = np.repeat(size, degree + 1)

    # z is linear in the parameters.
    moves = np.hstack([shape, 1j * w[:, None] * shape]) * size

    def variance(z: np.ndarray, distortion: np.ndarray) -> np.ndarray:
        return variance_of_difference(sff + floor, syy + distortion, sfy, z)

    def left(parameters: np.ndarray, distortion: np.ndarray) -> np.ndarray:
        z = moves @ parameters - mass * w**2
        e = (force - z * moved) / np.sqrt(variance(z, distortion) / 2)
        return np.concatenate([e.real, e.imag])

    def slopes(parameters: np.ndarray, distortion: np.ndarray) -> np.ndarray:
        z = moves @ parameters - mass * w**2
        v = variance(z, distortion)[:, None]
        e = (force - z * moved)[:, None] / np.sqrt(v / 2)
        changes = 2 * np.real(np.conj(moves) * (z * (syy + distortion) - sfy)[:, None])
        d = -moved[:, None] * moves / np.sqrt(v / 2) - e * changes / (2 * v)
        return np.concatenate([d.real, d.imag])

    guess = np.zeros((2, degree + 1))
    guess[:, 0] = start
    at, spare = guess.ravel() / size, 2 * f.size - guess.size
    disturbing, distortion = 0.0, np.zeros(f.size)  # power of the force and, at each line, of what it moves
    for _ in range(ROUNDS):
        found = scipy.optimize.least_squares(left, at, slopes, method="lm", args=(distortion,))
        at, ratio = found.x, 2 * found.cost / spare
        z = moves @ at - mass * w**2
        disturbing += (ratio - 1) * float(np.mean(variance(z, distortion)))
        if abs(ratio - 1) < ENOUGH or disturbing <= 0:
            break
        distortion = disturbing / abs(z) ** 2
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * max(1.0, ratio) * np.outer(size, size)
    distorted = 1 - float(np.mean(variance(z, np.zeros(f.size)) / variance(z, distortion)))
    share = np.sum(abs(moved) ** 2) / np.sum(abs(statistics.amplitude("displacement")) ** 2)
    covariance[0, 0] *= 1 + PARTNERS * share * distorted
    half = float(reach(spare, level))

    def mean(coefficients: np.ndarray, square: float) -> BandMean:
        value, se = float(coefficients[0]), float(np.sqrt(square))
        curve = legval(GRID, coefficients)
        inside = (float(curve.min()), float(curve.max())) if degree else None
        return BandMean(value, se, value - half * se, value + half * se, inside)

    k, c = np.split(found.x * size, 2)
    return mean(k, covariance[0, 0]), mean(c, covariance[degree + 1, degree + 1])
