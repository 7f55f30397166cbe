"""Linear equations over lanes: lags that are there and lags that are not, modes, and what a kernel reads of them."""

import numpy as np
import pytest

from maglev_env.loop.system import System

STEP = np.array([1e-3, 1e-4, 1e-4, 1.0])
FIRST, SECOND = np.array([2e-3, 0.0, 3e-4, 0.0]), np.array([0.0, 5e-4, 1e-4, 0.0])
S = 2j * np.pi * 70.0


def response(system, lane, entering, leaving):
    """Of a signal at S, from a state that nobody writes."""
    a = system.a[lane] / system.step[lane]
    at = system.at(entering)[0]
    free = np.delete(np.arange(len(a)), at)
    states = np.linalg.solve(S * np.eye(len(free)) - a[np.ix_(free, free)], a[free, at])
    return leaving[lane, free] @ states + leaving[lane, at]


@pytest.mark.parametrize("packed", (False, True))
def test_a_cascade_of_lags_passes_where_one_is_absent(packed):
    system = System(("a", "b", "in"), STEP, packed)
    out = system.lags(("a", "b"), (FIRST, SECOND), system.signal("in"))
    for lane in range(4):
        expected = 1 / ((1 + S * FIRST[lane]) * (1 + S * SECOND[lane]))
        assert response(system, lane, "in", out) == pytest.approx(expected, rel=1e-12)
    expected = [[1, 0], [1, 0], [1, 1], [0, 0]] if packed else [[1, 0], [0, 1], [1, 1], [0, 0]]
    np.testing.assert_array_equal(system.there[:, :2], expected)
    assert not system.a[~system.there].any()


def test_an_absent_lag_shows_the_signal_that_enters_it():
    system = System(("a", "b", "in"), STEP)
    system.lags(("a", "b"), (FIRST, SECOND), system.signal("in"))
    a, b, into = np.eye(3)
    np.testing.assert_array_equal(system.shown[:, 0], [a, into, a, into])
    np.testing.assert_array_equal(system.shown[:, 1], [a, b, b, into])
    np.testing.assert_array_equal(system.shown[:, 2], [into] * 4)


def test_a_mode_has_its_frequency_and_damping_in_every_unit_of_time():
    frequency, ratio = np.full(4, 150.0), np.full(4, 0.03)
    system = System(("x", "v", "in"), STEP)
    returning = system.oscillator(("x", "v"), frequency, ratio)
    system.put("v", returning + system.signal("in"))
    w = 2 * np.pi * 150.0
    for lane in range(4):
        expected = 1 / (S**2 + 2 * 0.03 * w * S + w**2) / STEP[lane] ** 2
        assert response(system, lane, "in", system.signal("x")) == pytest.approx(expected, rel=1e-11)


def test_a_chain_of_integrals():
    system = System(("x", "x'", "x''"), STEP)
    system.integrate(("x", "x'", "x''"))
    np.testing.assert_array_equal(system.a, np.tile(np.eye(3, k=1), (4, 1, 1)))


def test_a_lean_system_leaves_out_what_no_lane_has():
    nobody, someone = np.zeros(4, dtype=bool), np.array([False, True, False, False])
    for lean in (False, True):
        system = System(("a", "b", "c"), STEP, lean=lean)
        assert system.without(("a", "b"), nobody) == lean
        np.testing.assert_array_equal(system.there, np.tile([not lean, not lean, True], (4, 1)))
        assert not system.without(("c",), someone) and system.there[:, 2].all()
