"""Windows along an instrument are chosen by what their neighbours let expect."""

import numpy as np
import pytest

from sim2real.recorded.drive.instrument import _expected


def test_no_window_is_chosen_by_its_own_power():
    rng = np.random.default_rng(1)
    driven = 10 ** rng.uniform(-1, 0, 50)
    power, noise = 20.0 * driven[None] + 1.0, np.ones((1, 50))
    plain = _expected(power, noise, driven)
    assert plain == pytest.approx(power)
    power[0, 20] *= 3
    assert _expected(power, noise, driven)[0, 20] == pytest.approx(plain[0, 20])


def test_a_sine_has_no_neighbours_that_tell():
    driven = np.zeros(50)
    driven[20] = 1.0
    power = 1.0 + 500.0 * driven[None]
    assert _expected(power, np.ones((1, 50)), driven)[0, 20] == pytest.approx(501.0)
