"""Records of one band with known noise, for the tests of the maximum likelihood estimator and its coverage."""

import numpy as np
from drawn_spectra import two_channels

F = np.arange(20.0, 32.0)
W = 2 * np.pi * F
BAND = np.array([[20.0, 31.0]])
M, K, C = 0.13, 2471.0, 3.1


def statistics(noise, k=K, c=C, correlation=0.0, periods=5, tilt=0.0, colour=0.0):
    """A band with equal noise shares in force and displacement, `tilt` per cent of stiffness that varies over it."""
    y = np.exp(0.9j * F) * np.linspace(1, 2, F.size)
    z = k * (1 + tilt / 100 * np.sin(3 * (F - 20) / 11)) - M * W**2 + 1j * W * c
    f, size = z * y, np.abs(z).mean()
    shape = np.exp(colour * np.sin(F))
    cross = correlation * noise**2 * size * shape
    covariance = np.array([[noise**2 * shape, np.conj(cross)], [cross, (noise * size) ** 2 * shape]])
    return two_channels(F, f, y, covariance, periods)
