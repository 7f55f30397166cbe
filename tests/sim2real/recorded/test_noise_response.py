"""What a change of the rig makes of noise is taken off along an instrument, and what it makes of the motion stays."""

import numpy as np
import pytest

from estimation.lines.line_windows import KEPT
from sim2real.recorded.noise_response import NoiseResponse

WINDOWS = 60


def complex_noise(rng: np.random.Generator) -> np.ndarray:
    shape = (1, 1, WINDOWS * KEPT)
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def test_an_answer_to_noise_explains_nothing_and_one_to_the_motion_all():
    rng, along = np.random.default_rng(2), np.tile(np.arange(KEPT) == 0, WINDOWS)
    of_noise, of_motion = [], []
    for _ in range(40):
        at, noise = 300.0 * complex_noise(rng) * along, complex_noise(rng)
        response = NoiseResponse(at, noise, np.ones_like(at, float), along)
        answered, moved = at + (0.1 + 0.05j) * noise, 1.01 * at + 0.01 * noise
        of_noise.append(np.vdot((response.without(answered) - at)[..., along], noise[..., along]))
        of_motion.append((response.without(moved) - at)[..., along] / (0.01 * at[..., along]))
    assert abs(np.mean(of_noise)) < 0.1 * 0.1 * WINDOWS  # it was a tenth of the noise's power
    assert np.mean(of_motion) == pytest.approx(1.0, abs=1e-3)


def test_a_gap_is_not_taken_for_noise():
    rng, along = np.random.default_rng(3), np.tile(np.arange(KEPT) == 0, WINDOWS)
    at, noise = 300.0 * complex_noise(rng) * along, complex_noise(rng)
    gap = noise + 100.0 * along
    response = NoiseResponse(at, gap, np.ones_like(at, float), along)
    change = 0.1 * gap
    kept = (response.without(at + change) - at)[..., along] / change[..., along]
    assert abs(np.mean(kept)) > 0.9
