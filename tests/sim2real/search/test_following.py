"""A change with all else following, against least squares that are solved anew."""

import numpy as np
import pytest

from sim2real.search.following import Following

RNG = np.random.default_rng(3)


def complex_rows(*shape):
    return RNG.standard_normal(shape) + 1j * RNG.standard_normal(shape)


JACOBIAN, PRIOR, U = complex_rows(4, 50), np.array([0.0, 1.0, 1.0, 0.2]), RNG.standard_normal(4)
RESIDUAL, CHANGES = 3 * complex_rows(50), complex_rows(2, 50)
FOLLOWS = Following(JACOBIAN, PRIOR, U, RESIDUAL)


def solved(residual):
    """The step and the cost of linear least squares with real unknowns, as one stacked real system."""
    rows = np.vstack([JACOBIAN.T.real, JACOBIAN.T.imag, np.diag(np.sqrt(PRIOR))])
    right = np.concatenate([residual.real, residual.imag, -np.sqrt(PRIOR) * U])
    step, *_ = np.linalg.lstsq(rows, right, rcond=None)
    return step, float(np.sum((right - rows @ step) ** 2))


def test_what_follows_is_the_least_squares_step():
    step, cost = solved(RESIDUAL - CHANGES[0])
    np.testing.assert_allclose(FOLLOWS.step(CHANGES[0]), step, rtol=1e-9)
    assert FOLLOWS.cost(CHANGES[0]) == pytest.approx(cost, rel=1e-9)
    before = float(np.vdot(RESIDUAL, RESIDUAL).real + PRIOR @ U**2)
    assert before - FOLLOWS.promised == pytest.approx(solved(RESIDUAL)[1], rel=1e-9)
    np.testing.assert_allclose(FOLLOWS.step(), solved(RESIDUAL)[0], rtol=1e-9)


@pytest.mark.parametrize("shares", [(0.3, 0.0), (-1.2, 0.7)])
def test_shares_of_changes_save_what_the_products_say(shares):
    own, along = FOLLOWS.along(CHANGES)
    shares = np.array(shares)
    saved = 2 * shares @ along - shares @ own @ shares
    assert FOLLOWS.cost(shares @ CHANGES) == pytest.approx(FOLLOWS.cost(0 * RESIDUAL) - saved, rel=1e-9)
    best = np.linalg.solve(own, along)
    least = FOLLOWS.cost(best @ CHANGES)
    assert all(FOLLOWS.cost((best + off) @ CHANGES) > least for off in 0.1 * np.eye(2))
