"""Intervals of times that are not negative, of which a record tells the sum alone."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.loop.card import SMALL_ROTOR
from sim2real.coefficients import Coefficient
from sim2real.one_sided import REACH, bounded_spread
from sim2real.search.fit import Fit
from sim2real.search.hypotheses import Hypothesis

SUM = 2.0  # what one unit of either time changes, in standard deviations of the noise


def _fit(delay, lag, residual):
    h = Hypothesis(("delay", "sensor_lag"), {}, scales=SMALL_ROTOR)
    rows = np.array([[SUM, 0.0], [SUM, 1e-6]], complex)
    return Fit(h, np.array([delay, lag]), np.array([residual, 0.0], complex), 0.0, rows)


def test_of_two_times_at_zero_each_may_have_what_both_together_have():
    fit = _fit(0.0, 0.0, 0.0)
    wide = np.sqrt(np.diag(fit.covariance()))
    assert wide.min() > 1e5
    np.testing.assert_allclose(bounded_spread(fit, wide), 1 / SUM, rtol=1e-3)


def test_one_time_may_grow_by_what_the_other_falls():
    spread = bounded_spread(_fit(0.0, 3.0, 0.0), np.ones(2))
    assert spread[0] == pytest.approx((3.0 + REACH / SUM) / REACH, rel=1e-3)
    assert spread[1] == pytest.approx(3.0 / REACH, rel=1e-3)  # down to zero, which is farther than up


def test_a_time_that_is_told_to_no_quarter_of_the_loops_own_is_not_bounded():
    told = Coefficient("delay", "s", 0.0, 1e-4, 0.0, True, most=2e-4)
    assert told.identified and told.with_error(1.5e-4).identified
    assert not told.with_error(0.4).identified
    assert not replace(told, bounded=False).with_error(1e-5).bounded
