"""The jump of the stiffness where a second body resonates, on dynamic stiffnesses in closed form."""

import numpy as np
import pytest

from estimation.stiffness_pole import stiffness_pole

F = np.arange(40.0, 360.0, 13.0)
W = 2 * np.pi * F
RNG = np.random.default_rng(8)


def noisy(k: np.ndarray, share: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    se = share * np.abs(k) + 1e3
    return k + se * RNG.standard_normal(k.size), se


@pytest.mark.parametrize("resonance", [110.0, 157.0, 161.0, 230.0])
def test_a_second_body_is_found_between_the_bands_beside_its_resonance(resonance):
    w2, loss = 2 * np.pi * resonance, 0.01
    # The second body moves by w2^2 / (w2^2 - w^2) of the first, and one mass of both takes its inertia as rigid.
    moved = w2**2 * (1 + 2j * loss * W / w2) / (w2**2 - W**2 + 2j * loss * W * w2)
    k = -4e5 + 0.6 * W**2 - (0.6 * W**2 * moved).real
    pole = stiffness_pole(F, *noisy(k))
    assert pole is not None
    assert pole.frequency[0] < resonance + 13 and pole.frequency[1] > resonance - 13
    assert pole.stiffness[1] > pole.stiffness[0]


def test_wide_bands_show_a_second_body_although_the_stiffness_rises_above_it():
    f, w2 = np.arange(20.0, 380.0, 36.0), 2 * np.pi * 100
    w = 2 * np.pi * f
    k = -7.7e5 + 1.25 * w**2 - 1.25 * w**2 * w2**2 / (w2**2 - w**2)
    pole = stiffness_pole(f, *noisy(k))
    assert pole is not None and pole.frequency[0] < 100 < pole.frequency[1]


@pytest.mark.parametrize(
    "law", [lambda f: -4e5 + 0 * f, lambda f: 2e5 - 900 * f, lambda f: 1e3 * f, lambda f: 3 * f**2]
)
def test_a_stiffness_without_a_pole_has_none(law):
    for _ in range(40):
        assert stiffness_pole(F, *noisy(law(F), 0.02)) is None


def test_few_bands_or_unbounded_ones_tell_nothing():
    assert stiffness_pole(F[:4], np.array([0.0, -5e5, 5e5, 0.0]), np.full(4, 1e3)) is None
    assert stiffness_pole(F, np.full(F.size, np.nan), np.full(F.size, np.inf)) is None


def test_the_stiffness_falls_from_the_band_next_to_the_jump():
    """A band that says nothing two before the jump does not hide it, and one beside the jump does."""
    w2 = 2 * np.pi * 124
    k = -4e5 + 0.6 * W**2 - 0.6 * W**2 * w2**2 / (w2**2 - W**2)
    low, error = int(np.flatnonzero(F < 124)[-1]), 1e-3 * np.abs(k)
    for which, found in ((low - 2, True), (low - 1, False)):
        blind = error.copy()
        blind[which] = 1e9
        pole = stiffness_pole(F, k, blind)
        assert (pole is not None and pole.frequency == (F[low], F[low + 1])) == found
