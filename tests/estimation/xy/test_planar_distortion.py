"""What is taken for distortion: hardly ever noise, and most of what is as large as the noise."""

import numpy as np
import pytest
from drawn_spectra import draw
from planar_records import DAMPING, DIAGONALS, MASS, STIFFNESS, correlated, noise_levels, planar_record

from estimation.xy import planar_distortion
from estimation.xy.planar_distortion import distorted
from estimation.xy.planar_lines import planar_lines

LANES = 400
BAND = np.array([62.5, 77.5])
MASSES = np.full((LANES, 2), MASS)
TRUE = np.tile(np.concatenate([STIFFNESS.ravel(), DAMPING.ravel()]), (LANES, 1))


def moved(f):
    """Displacement of a force at each line (n, 2, 2)."""
    w = 2 * np.pi * f[:, None, None]
    return np.linalg.inv(STIFFNESS - np.eye(2) * MASS * w**2 + 1j * w * DAMPING)


def lines(size, counts=(15, 15), periods=(5, 5), correlation=None, bent=(0, 1)):
    """Of two records with a force of an rms size at each line that is not recorded, as share of the one that is.

    It is in the records `bent`.
    """
    rng, records = np.random.default_rng(15), []
    for i, (count, p) in enumerate(zip(counts, periods, strict=True)):
        f = 70.0 + np.linspace(-7.0, 7.0, count)
        expected = planar_record(f, DIAGONALS[i], noise_levels(f, 100), correlation, periods=p)
        drawn = draw(expected, LANES, (16, i))
        force = size * (rng.standard_normal((LANES, f.size, 2, 2)) @ np.array([1, 1j])) / np.sqrt(2)
        drawn.mean[:, 2:] += (i in bent) * np.moveaxis((moved(f) @ force[..., None])[..., 0], 1, 2)
        records.append(drawn)
    return planar_lines(records, BAND)


def test_noise_is_hardly_ever_taken_for_distortion():
    rough, share = distorted(lines(0.0), MASSES, TRUE)
    assert (share > 0).mean() < 0.01 and len(rough.u) == (share > 0).sum()


@pytest.mark.parametrize(
    ("counts", "periods", "correlation"),
    [
        ((15, 15), (2, 2), None),
        ((15, 15), (5, 5), correlated(3)),
        ((36, 4), (5, 5), None),  # four lines, of which curves of five coefficients leave next to nothing
        ((36, 8), (9, 3), None),
        ((6, 6), (5, 5), None),  # hardly more lines than the curves have coefficients
    ],
    ids=["few periods", "both axes together", "few lines", "unequal periods", "hardly enough lines"],
)
def test_noise_is_taken_for_distortion_as_often_as_said(monkeypatch, counts, periods, correlation):
    """By simulation, at a probability that 400 draws can tell: 0.05 +- 0.011."""
    monkeypatch.setattr(planar_distortion, "BY_CHANCE", 0.05)
    _, share = distorted(lines(0.0, counts, periods, correlation), MASSES, TRUE)
    assert 0.02 < (share > 0).mean() < 0.085


def test_of_fewer_lines_than_the_curves_take_nothing_is_said():
    rough, share = distorted(lines(0.1, (6, 4)), MASSES, TRUE)
    assert not share.any() and not len(rough.u)


@pytest.mark.parametrize("counts", [(15, 15), (36, 4)])
def test_a_force_that_is_not_recorded_is_found_and_counts_as_the_noise_that_it_makes(counts):
    size = 0.016
    plain = lines(size, counts)
    rough, share = distorted(plain, MASSES, TRUE)
    assert (share > 0).mean() > 0.9
    added = (rough.own - plain.own[share > 0])[..., 2:, 2:]
    moves = moved(plain.w / (2 * np.pi))
    expected = size**2 * moves @ np.conj(np.swapaxes(moves, -1, -2))
    found = np.diagonal(added.mean(axis=0), axis1=-2, axis2=-1).real
    wanted = np.diagonal(expected, axis1=-2, axis2=-1).real
    assert np.abs(found / wanted - 1).max() < 0.35
    assert np.abs(found / wanted - 1)[plain.record == 0].max() < 0.2


def test_what_one_record_scatters_is_not_counted_in_another():
    plain = lines(0.1, bent=(0,))
    rough, share = distorted(plain, MASSES, TRUE)
    added = np.diagonal((rough.own - plain.own[share > 0])[..., 2:, 2:], axis1=-2, axis2=-1).real.mean(axis=0)
    other, own = (added[plain.record == i] for i in (1, 0))  # at the same frequencies
    assert (share > 0).all() and (other < 0.05 * own).all()
