"""What is taken for distortion: hardly ever noise, and most of what is as large as the noise."""

import numpy as np
from drawn_spectra import draw
from planar_records import DAMPING, DIAGONALS, MASS, STIFFNESS, noise_levels, planar_record

from estimation.xy.planar_distortion import distorted
from estimation.xy.planar_lines import planar_lines

LANES = 400
F = 70.0 + np.arange(-7.0, 8.0)
MASSES = np.full((LANES, 2), MASS)
TRUE = np.tile(np.concatenate([STIFFNESS.ravel(), DAMPING.ravel()]), (LANES, 1))


def lines(size):
    """Of two records with a force of an rms size at each line that is not recorded, as share of the one that is."""
    rng, records = np.random.default_rng(15), []
    w = 2 * np.pi * F[:, None, None]
    moves = np.linalg.inv(STIFFNESS - np.eye(2) * MASS * w**2 + 1j * w * DAMPING)
    for i, direction in enumerate(DIAGONALS):
        drawn = draw(planar_record(F, direction, noise_levels(F, 100)), LANES, (16, i))
        force = size * (rng.standard_normal((LANES, F.size, 2, 2)) @ np.array([1, 1j])) / np.sqrt(2)
        drawn.mean[:, 2:] += np.moveaxis((moves @ force[..., None])[..., 0], 1, 2)
        records.append(drawn)
    return planar_lines(records, np.array([62.5, 77.5]))


def test_noise_is_hardly_ever_taken_for_distortion():
    rough, share = distorted(lines(0.0), MASSES, TRUE)
    assert (share > 0).mean() < 0.01 and len(rough.u) == (share > 0).sum()


def test_a_force_that_is_not_recorded_is_found_and_counts_as_the_noise_that_it_makes():
    plain, size = lines(0.016), 0.016
    rough, share = distorted(plain, MASSES, TRUE)
    assert (share > 0).mean() > 0.9
    added = (rough.own - plain.own[share > 0])[..., 2:, 2:]
    w = 2 * np.pi * F[:, None, None]
    moves = np.linalg.inv(STIFFNESS - np.eye(2) * MASS * w**2 + 1j * w * DAMPING)
    expected = size**2 * moves @ np.conj(np.swapaxes(moves, -1, -2))
    found = np.diagonal(added.mean(axis=0), axis1=-2, axis2=-1).real
    wanted = np.tile(np.diagonal(expected, axis1=-2, axis2=-1).real, (2, 1))
    assert np.abs(found / wanted - 1).max() < 0.2
