"""The branches of the eddy currents against the fractional lag that they stand for."""

import numpy as np

from maglev_env.loop.eddy import BRANCHES, eddy_branches

ORDERS = np.linspace(0.3, 0.98, 18)
CORNERS = np.geomspace(50.0, 5e4, 40)


def fractional(s, corner, order, depth=None):
    lag = (s / (2 * np.pi * corner)) ** order
    if depth is not None:
        z = np.sqrt(s / (2 * np.pi * depth))
        lag = lag * ((z / np.tanh(z) - 1) / z) ** (2 - 2 * order)
    return 1 / (1 + lag)


def branches(s, corner, order, depth=0.0):
    direct, weights, rates = eddy_branches(corner, order, depth)
    return direct + (weights * rates / (s[:, None] + rates)).sum(axis=1)


def test_the_branches_of_the_eddy_currents_meet_the_fractional_lag():
    s = 2j * np.pi * np.geomspace(1.0, 2000.0, 200)
    for order in ORDERS:
        for corner in CORNERS:
            ratio = branches(s, corner, order) / fractional(s, corner, order)
            assert np.abs(np.abs(ratio) - 1).max() < 3e-3 and np.abs(np.angle(ratio, deg=True)).max() < 0.2
    for corner in (1.0, 10.0, 1e6):
        ratio = branches(s, corner, 0.5) / fractional(s, corner, 0.5)
        assert np.abs(ratio - 1).max() < 0.03


def test_iron_of_a_finite_depth_is_met_as_closely_as_is_said():
    s = 2j * np.pi * np.geomspace(1.0, 2000.0, 200)
    for order in ORDERS[::3]:
        for corner in CORNERS[::3]:
            share, degrees = (0.02, 1.0) if corner >= 1e3 else (0.07, 4.0)
            for depth in np.geomspace(0.1, 1e4, 11):
                ratio = branches(s, corner, order, depth) / fractional(s, corner, order, depth)
                assert np.abs(ratio - 1).max() < share and np.abs(np.angle(ratio, deg=True)).max() < degrees


def test_the_branches_are_smooth_in_corner_and_order_and_vanish_with_an_infinite_corner():
    direct, weights, rates = eddy_branches(CORNERS[:, None], ORDERS)
    assert weights.shape == rates.shape == (*direct.shape, BRANCHES)
    np.testing.assert_allclose(direct + weights.sum(axis=-1), 1.0, rtol=1e-12)
    assert (rates > 0).all() and (np.diff(rates) > 0).all()
    for a, b in ((eddy_branches(300.0, 0.7), eddy_branches(300.0 * (1 + 1e-6), 0.7 + 1e-6)),
                 (eddy_branches(8e3, 0.97), eddy_branches(8e3 * (1 + 1e-6), 0.97 + 1e-6))):  # fmt: skip
        for first, second in zip(a, b, strict=True):
            assert np.abs(second - first).max() < 1e-3 * np.abs(first).max()
    one = eddy_branches(CORNERS[7], ORDERS[3])
    for alone, among in zip(one, (direct[7, 3], weights[7, 3], rates[7, 3]), strict=True):
        np.testing.assert_allclose(alone, among, rtol=1e-9)
    direct, weights, rates = eddy_branches(np.array([np.inf, 1e6]), 0.5)
    assert direct[0] == 1 and not weights[0].any() and (rates[0] > 0).all() and 0.9 < direct[1] < 1
