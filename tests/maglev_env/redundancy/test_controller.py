"""A command that its limits cut off does not follow from the displacement by a linear controller."""

from typing import Any

import numpy as np
import pytest

from maglev_env.redundancy.controller import Compared, cut_off, moving

STEP = 6.0 / 4096


def test_the_kicks_of_a_derivative_at_a_limit_are_told_and_noise_and_sines_are_not():
    rng, n = np.random.default_rng(1), 30_000
    said = []
    for _ in range(200):
        command = 0.9 + 0.03 * rng.standard_normal(n)
        said.append(cut_off(np.rint(command / STEP) * STEP))
        command[:: n // 20] += rng.choice([-2.0, 1.0], command[:: n // 20].size)
        assert cut_off(np.rint(np.maximum(command, 0.0) / STEP) * STEP)
    assert np.mean(said) < 0.02
    for cycles in (0.5, 3.0, 50.3, 700.1):
        sine = np.sin(2 * np.pi * cycles * np.arange(n) / n)
        assert not cut_off(np.rint(sine / STEP) * STEP)


@pytest.mark.parametrize(("referred", "refers"), [(None, False), (1e-16, False), (1e-4, True)])
def test_a_constant_set_point_is_not_compared_with_the_command(referred, refers):
    drive = np.full((2, 5), 0.1 + 0j)
    own = None if referred is None else np.full((2, 5), referred + 0j)
    no_fit: Any = None
    assert Compared(no_fit, drive, drive, True, own).refers == refers


@pytest.mark.parametrize(("size", "moved"), [(1e-17, False), (1e-3, True)])
def test_a_set_point_of_the_other_axis_moves_nothing_here(size, moved):
    """Turned by 90 degrees, a sine of it leaves 6e-17 of its amplitude."""
    rng = np.random.default_rng(3)
    drive, command = size * rng.standard_normal((2, 50)), 0.01 * rng.standard_normal((2, 50))
    assert moving(drive, command).all() == moved and moving(drive, command).any() == moved
