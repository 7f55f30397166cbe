"""The simple form of a curve: of curves with noise, drawn here."""

import numpy as np
import pytest

from maglev_env.loop.free.element import SHARES
from sim2real.free.shape import form_of

AT = np.array([*(-s for s in SHARES[::-1]), *SHARES])
SD = 0.02
CURVES = {
    "straight": 0.5 * AT,
    "one-sided": 0.5 * abs(AT) + 0.3 * AT,
    "bent": -0.5 * AT**2,
    "cubic": 0.5 * AT**3 - 0.4 * AT,
    "step": -0.3 * np.sign(AT),
    "kink above": 0.6 * np.maximum(AT - 0.4, 0.0),
    "band": -np.clip(AT, -0.4, 0.4) + 0.2 * AT,
}


@pytest.mark.parametrize("name", CURVES)
def test_it_is_found_in_noise(name):
    rng = np.random.default_rng(3)
    found = [form_of(1e-5 * AT, CURVES[name] + SD * rng.standard_normal(10), SD**2 * np.eye(10)) for _ in range(40)]
    assert sum(f.name == name for f in found) >= 30
    if name in ("kink above", "band"):
        right = [f for f in found if f.name == name]
        assert np.median([f.knee for f in right]) == pytest.approx(0.4e-5, rel=0.25)
        assert sum(f.knee_ends[0] <= 0.4e-5 <= f.knee_ends[1] for f in right) >= 0.8 * len(right)


def test_a_wave_is_no_simple_form():
    assert form_of(AT, np.sin(3 * np.pi * AT + 0.3) - np.sin(0.3), 1e-4 * np.eye(10)).name == "free"


@pytest.mark.parametrize("sign", [1, -1])
def test_the_size_of_a_kink_has_the_sign_of_what_it_adds_where_it_adds_most(sign):
    """0.2 less beyond 0.4 of the range on either side."""
    beyond = np.maximum(AT - 0.4, 0.0) if sign > 0 else np.maximum(-AT - 0.4, 0.0)
    found = form_of(AT, -0.2 * beyond, 1e-6 * np.eye(AT.size))
    assert found.name == ("kink above" if sign > 0 else "kink below")
    assert found.size == pytest.approx(-0.2 * beyond.max(), rel=0.05) and found.se > 0
