"""Set points that move beside what repeats in them."""

import numpy as np
from scipy.signal import lfilter

from maglev_env.recordings.guess.excitation import guess_excitation


def test_noise_on_a_square_wave_is_no_period():
    square = np.where((np.arange(9000) // 300) % 2, 150.0, -150.0)
    rng = np.random.default_rng(1)
    noise = lfilter([0.02], [1, -0.98], rng.standard_normal(9000))
    noise *= 50 / noise.std()
    moved = np.roll(square + noise, 5)
    kinds = [
        guess_excitation({"reference": wanted, "displacement": moved}, 1000.0)[0][0]["kind"]
        for wanted in (square + noise, square, square + 5 * rng.standard_normal(9000))
    ]
    assert kinds == ["recorded", "multisine", "multisine"]
