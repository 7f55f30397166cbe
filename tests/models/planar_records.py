"""Records of a planar rig with known coefficients, for the tests of the planar estimators."""

import numpy as np
from drawn_spectra import draw

from estimation.lines.periods import LineStatistics
from estimation.xy.planar_lines import CHANNELS

MASS = 0.92
STIFFNESS = np.array([[130e3, 8e3], [-6e3, 125e3]])
DAMPING = np.array([[20.0, 3.0], [-2.0, 25.0]])
SYMMETRIC = {"stiffness": np.array([[120e3, 9e3], [9e3, 120e3]]), "damping": np.array([[22.0, 3.0], [3.0, 22.0]])}
DIAGONALS = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2)
VERTICAL = DIAGONALS[0]
F = np.arange(63.0, 78.0)
BAND = np.array([[62.5, 77.5]])


def planar_record(
    frequency,
    direction,
    noise=(0.0, 0.0),
    correlation=None,
    stiffness=STIFFNESS,
    damping=DAMPING,
    mass=(MASS, MASS),
    periods=5,
    tilt=0.0,
):
    """A record without lanes: force along `direction` (2,) or (n, 2), noise of force and displacement means.

    noise: standard deviations, each a scalar or one per axis; tilt: share of the stiffness that varies over the band.
    """
    w = 2 * np.pi * frequency[:, None, None]
    force = np.broadcast_to(direction, (frequency.size, 2)) * np.exp(0.7j * frequency[:, None] ** 1.5)
    z = stiffness * (1 + tilt * np.sin((w - w[0]) / 20)) - np.diag(mass) * w**2 + 1j * w * damping
    mean = np.concatenate([force, np.linalg.solve(z, force[..., None])[..., 0]], axis=1).T
    sd = np.concatenate([np.broadcast_to(n, 2) for n in noise])
    covariance = (np.eye(4) if correlation is None else correlation) * np.outer(sd, sd) + 0j
    return LineStatistics(
        frequency,
        np.round(2 * frequency).astype(int),
        CHANNELS,
        mean,
        np.repeat(covariance[:, :, None], frequency.size, 2),
        periods,
    )


def noise_levels(frequency, ratio, **rig):
    """Noise of force and displacement, this far below the root mean square a line has along its excitation."""
    both = [planar_record(frequency, d, **rig).mean for d in DIAGONALS]
    return 1 / np.sqrt(2) / ratio, np.sqrt(np.mean([np.abs(m[2:]) ** 2 for m in both])) / ratio


def correlated(seed):
    """A correlation matrix of four channels in which none is independent of another."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((4, 4)) + 1j * rng.standard_normal((4, 4))
    matrix = root @ np.conj(root.T) + np.eye(4)
    scale = np.sqrt(np.diag(matrix).real)
    return matrix / np.outer(scale, scale)


def diagonal_records(ratio, lanes=None, seed=0, frequency=F, **rig):
    """Two records along +-45 degrees, expected or drawn."""
    levels = noise_levels(frequency, ratio) if np.isfinite(ratio) else (0.0, 0.0)
    expected = [planar_record(frequency, d, levels, **rig) for d in DIAGONALS]
    return expected if lanes is None else [draw(r, lanes, (seed, i)) for i, r in enumerate(expected)]
