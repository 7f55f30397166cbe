"""The noise of a hammer's force between its blows."""

import numpy as np
import pytest

from sim2real.recorded.drive.blows import between_blows

NOISE, OFFSET = 0.02, 0.3


def struck(rng, peak=20.0, every=2000, size=20_000):
    """(with noise, without) force (1, samples) of half sines of 12 samples."""
    force = np.zeros(size)
    for at in range(500, size - 500, every):
        force[at : at + 12] = peak * np.sin(np.pi * np.arange(12) / 12)
    return (force + OFFSET + NOISE * rng.standard_normal(size))[None], force[None] + OFFSET


def test_between_the_blows_the_force_is_constant_and_a_blow_is_as_recorded():
    noisy, plain = struck(np.random.default_rng(1))
    found, said = between_blows(noisy, NOISE)
    blow = plain - OFFSET > 0.1
    np.testing.assert_array_equal(found[blow], noisy[blow])
    away = ~np.convolve(blow[0], np.ones(61), "same").astype(bool)
    assert np.ptp(found[0, away]) == 0 and found[0, away].mean() == pytest.approx(OFFSET, abs=1e-3)
    assert "0.02 N" in said


@pytest.mark.parametrize("kind", ["random force", "no noise", "more noise than stated", "few newtons", "mostly blows"])
def test_what_is_no_hammer_is_left_alone(kind):
    rng = np.random.default_rng(2)
    force = {
        "random force": rng.standard_normal((1, 20_000)),
        "no noise": struck(rng)[1],
        "more noise than stated": struck(rng)[0] * 3,
        "few newtons": struck(rng, peak=0.5)[0],
        "mostly blows": struck(rng, every=40)[0],
    }[kind]
    found, said = between_blows(force, NOISE)
    assert said is None and found is force
