"""Fits of whitened residuals against linear algebra, brute force, and the scatter over many records."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import planned, repeated

from maglev_env.loop.effect import effect
from maglev_env.rig.rig import with_parameters
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import TOLERANCE_EFFECTS, tolerances
from sim2real.compared.problem import assemble
from sim2real.search import fitting
from sim2real.search.candidates import Candidate
from sim2real.search.fit import NOT_TOLD, Fit, cost_of, inverse
from sim2real.search.fitting import begin, differentiate, iterate, share_calibrations
from sim2real.search.hypotheses import FORM, FORM_SHARE, MOST_FORM, Hypothesis

TOLERANCE = {"probe_gain": 0.02, "negative_stiffness": 0.1}
NAMES = ("mass", "actuator_gain", "probe_gain", "negative_stiffness")
TOY = Hypothesis(("mass", "actuator_gain"), TOLERANCE)
ROWS = 60


class Linear:
    """A prediction that is linear in the coordinates of a hypothesis like TOY."""

    def __init__(self, seed, size=1.0):
        rng = np.random.default_rng(seed)
        self.columns = size * (rng.standard_normal((4, ROWS)) + 1j * rng.standard_normal((4, ROWS)))
        self.rng, self.lanes = rng, 0

    def coordinates(self, point):
        values = {**{n: e["change"] / 0.1 for n, e in point.effects.items()},
                  **{n: change / TOLERANCE[n] for n, change in point.changes.items()}}  # fmt: skip
        return np.array([values.get(name, 0.0) for name in NAMES])

    def __call__(self, points):
        self.lanes += len(points)
        return np.array([self.coordinates(p) @ self.columns for p in points])

    def data(self, u):
        return u @ self.columns + self.rng.standard_normal(ROWS) + 1j * self.rng.standard_normal(ROWS)

    def solved(self, data, kept=slice(None)):
        """Least squares of real and imaginary parts, a tolerance being one more observation."""
        a = np.vstack([self.columns.T[kept].real, self.columns.T[kept].imag, np.diag([0.0, 0.0, 1.0, 1.0])])
        b = np.concatenate([data[kept].real, data[kept].imag, np.zeros(4)])
        return np.linalg.lstsq(a, b, rcond=None)[0], np.linalg.inv(a.T @ a)


class Bent(Linear):
    """The same, but for the second coordinate, of which the square of the first one is subtracted: a narrow valley."""

    def __call__(self, points):
        u = np.array([self.coordinates(p) for p in points])
        u[:, 1] = 100 * (u[:, 1] - u[:, 0] ** 2)
        return u @ self.columns


def fitted(toy, data, hypothesis=TOY, u=None, most=12):
    fits = begin([hypothesis], [np.zeros(hypothesis.size) if u is None else u], data, toy)
    iterate(fits, data, toy, most)
    differentiate(fits, data, toy, True)
    return fits[0]


@pytest.mark.parametrize("parabolas", [True, False])
def test_a_valley_that_bends_is_followed_along_parabolas(monkeypatch, parabolas):
    toy = Bent(1)
    data = toy.data(np.array([2.0, 0.0, 0.0, 0.0]))
    if not parabolas:
        monkeypatch.setattr(fitting, "MUCH", np.inf)
    fit = fitted(toy, data, u=np.array([-2.0, 4.0, 0.0, 0.0]), most=40)
    assert (fit.cost < 2.5 * ROWS) == parabolas


def test_a_linear_fit_is_least_squares_with_its_priors():
    toy = Linear(1, 0.5)
    data = toy.data(np.array([2.0, -1.0, 3.0, 0.5]))  # a tolerance off by three of its own
    own, (solved, covariance) = fitted(toy, data), toy.solved(data)
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((own.u - solved) / scale, 0.0, atol=0.02)
    np.testing.assert_allclose(own.covariance(), covariance, rtol=1e-6, atol=1e-9)
    left = data - solved @ toy.columns
    assert own.cost == pytest.approx((abs(left) ** 2).sum() + (solved[2:] ** 2).sum(), rel=1e-6)
    np.testing.assert_allclose(own.jacobian, toy.columns, atol=1e-9)
    free = np.linalg.lstsq(np.r_[toy.columns.T.real, toy.columns.T.imag], np.r_[data.real, data.imag], rcond=None)[0]
    assert abs((solved - free) / scale).max() > 0.1  # the priors are felt


def test_the_gradient_is_that_of_the_cost():
    toy = Linear(2)
    data = toy.data(np.ones(4))
    fit = begin([TOY], [np.array([0.5, 2.0, 1.0, -1.0])], data, toy)[0]
    differentiate([fit], data, toy, True)
    for i, d in enumerate(1e-5 * np.eye(4)):
        up, down = (cost_of(data - (fit.u + s * d) @ toy.columns, fit.u + s * d, fit.prior) for s in (1, -1))
        assert fit.gradient[i] == pytest.approx(-(up - down) / 4e-5, rel=1e-6)


def test_the_predictive_cost_is_that_of_another_record():
    """On the mean over 300 records, of which the noise is known: their fits cost another record its own noise, and what
    the fit is off."""
    toy, h = Linear(10), Hypothesis(("mass", "actuator_gain"), {})
    truth, told, seen = np.array([1.0, 2.0, 0.0, 0.0]), [], []
    for _ in range(300):
        data = toy.data(truth)
        fit = fitted(toy, data, h, truth[:2], most=3)
        off = (np.r_[fit.u, 0.0, 0.0] - truth) @ toy.columns
        expected = (abs(data - truth @ toy.columns) ** 2).sum() + (abs(off) ** 2).sum()
        told.append(Candidate(fit).predictive - expected)
        seen.append(fit.cost - expected)
    error = np.std(told, ddof=1) / np.sqrt(300)
    assert error < 0.4 and abs(np.mean(told)) < 3 * error
    assert np.mean(seen) < -5 * error  # what a fit has seen flatters it


def test_bounds_hold():
    delay = Hypothesis(("delay",), {})
    rng = np.random.default_rng(3)
    slope = rng.standard_normal(ROWS) + 1j * rng.standard_normal(ROWS)
    tried = []

    def simulate(points):
        tried.extend(p.effects["delay"]["time"] for p in points)
        return np.array([p.effects["delay"]["time"] / 1e-5 * slope for p in points])

    for truth, bound in ((-4.0, 0.0), (150.0, 100.0)):  # a delay is 0 .. 1 ms
        data = truth * slope + 0.1 * rng.standard_normal(ROWS)
        fits = begin([delay], [np.array([50.0])], data, simulate)
        iterate(fits, data, simulate, 30)
        assert fits[0].u[0] == pytest.approx(bound, abs=1e-9)
    assert min(tried) >= 0.0 and max(tried) <= 1e-3


def test_a_step_into_touchdown_is_not_taken():
    toy = Linear(4)
    data = toy.data(np.array([6.0, 1.0, 0.0, 0.0]))

    def falls(points):
        found = toy(points)
        found[[toy.coordinates(p)[0] > 4.0 for p in points]] = np.nan
        return found

    fit = fitted(falls, data, most=20)
    assert 3.0 < fit.u[0] <= 4.0 and np.isfinite(fit.cost)
    assert fit.cost < cost_of(data, np.zeros(4), fit.prior)
    fallen = begin([TOY], [np.array([5.0, 0.0, 0.0, 0.0])], data, falls)
    iterate(fallen, data, falls, 3)
    assert fallen[0].cost == np.inf and fallen[0].jacobian is None


def test_a_step_into_touchdown_is_followed_by_shorter_ones():
    """Straight on lies touchdown; the way there bends, and its end is short of it."""
    toy = Linear(13)
    bent = Hypothesis(("mass",), {})

    def falls(points):
        u = np.array([toy.coordinates(p)[0] for p in points])
        return np.where(u > 1.5, np.nan, np.sinh(u))[:, None] * toy.columns[0]

    data = np.sinh(1.4) * toy.columns[0]
    fits = begin([bent], [np.zeros(1)], data, falls)
    iterate(fits, data, falls, 20)
    assert fits[0].u[0] == pytest.approx(1.4, abs=1e-3) and fits[0].done


def test_fits_of_a_batch_do_not_know_each_other():
    """In any order, and alone, as long as none is given up for another's sake."""
    toy = Linear(5, 0.3)
    data = toy.data(np.array([1.0, 1.0, 0.3, -0.5]))
    hypotheses = [TOY, Hypothesis(("mass",), TOLERANCE), Hypothesis(("actuator_gain",), {"probe_gain": 0.02})]

    def run(order):
        own = [hypotheses[i] for i in order]
        fits = begin(own, [0.1 * np.ones(h.size) for h in own], data, toy)
        iterate(fits, data, toy, 8)
        return dict(zip(order, fits, strict=True))

    forward, backward = run([0, 1, 2]), run([2, 1, 0])
    for i, alone in ((i, run([i])[i]) for i in range(3)):
        for other in (forward[i], backward[i]):
            np.testing.assert_array_equal(other.u, alone.u)
            assert other.cost == alone.cost


def test_a_hopeless_fit_is_left_where_it_is():
    """Near the best one after some steps it goes on; far from it it costs no more lanes."""
    toy = Linear(6, 4.0)
    data = toy.data(np.array([9.0, 0.0, 0.0, 0.0]))
    right, wrong = Hypothesis(("mass",), {}), Hypothesis(("actuator_gain",), {})
    fits = begin([right, wrong], [np.zeros(1)] * 2, data, toy)
    iterate(fits, data, toy, 10)
    assert fits[0].u[0] == pytest.approx(9.0, abs=0.2) and fits[1].done
    assert fits[1].cost > 100 * fits[0].cost


def test_a_fit_is_followed_only_where_it_promises_to_matter():
    """It ends before its first trial where the cost that a linear look promises is still above what was asked."""
    toy = Linear(6, 4.0)
    data = toy.data(np.array([9.0, 0.0, 0.0, 0.0]))
    mass, gain = Hypothesis(("mass",), {}), Hypothesis(("actuator_gain",), {})
    fits = begin([mass, gain], [np.zeros(1)] * 2, data, toy)
    start = fits[0].cost
    lanes = toy.lanes
    iterate(fits, data, toy, 10, [0.02 * start, 0.02 * start])
    assert fits[0].u[0] == pytest.approx(9.0, abs=0.2) and fits[0].cost < 0.02 * start
    assert fits[1].done and fits[1].u[0] == 0.0 and fits[1].cost == start
    followed = toy.lanes - lanes
    alone = begin([mass], [np.zeros(1)], data, toy)
    lanes = toy.lanes
    iterate(alone, data, toy, 10)
    assert followed == toy.lanes - lanes + 1  # the one row that the look takes


def test_rows_of_the_tolerances_are_handed_on():
    toy = Linear(7)
    data = toy.data(np.zeros(4))
    known = fitted(toy, data)
    fits = begin([Hypothesis(("mass",), TOLERANCE)], [np.zeros(3)], data, toy)
    share_calibrations(fits, known)
    np.testing.assert_allclose(fits[0].jacobian[1:], toy.columns[2:], atol=1e-9)
    assert not fits[0].jacobian[0].any()
    known = fitted(toy, data, Hypothesis((), {"probe_gain": 0.02}))
    fits = begin([Hypothesis(("mass",), TOLERANCE)], [np.zeros(3)], data, toy)
    share_calibrations(fits, known)
    assert fits[0].jacobian is None  # the other fit does not know all of its tolerances


def test_a_long_valley_is_followed_to_its_end():
    """Two columns that differ by a thousandth: the prior alone tells how they share."""
    toy = Linear(11, 30.0)
    toy.columns[2] = toy.columns[0] + 1e-3 * toy.columns[2]
    data = toy.data(np.array([8.0, -3.0, 2.0, 0.5]))
    own, (solved, covariance) = fitted(toy, data, most=12), toy.solved(data)
    np.testing.assert_allclose((own.u - solved) / np.sqrt(np.diag(covariance)), 0.0, atol=0.1)
    assert own.done


def test_a_fit_goes_along_a_bound():
    """What pushes one coordinate over its bound does not hold the others back."""
    delay = Hypothesis(("delay", "mass"), {})
    rng = np.random.default_rng(12)
    columns = rng.standard_normal((2, ROWS)) + 1j * rng.standard_normal((2, ROWS))
    columns[1] += 3 * columns[0]

    def simulate(points):
        u = np.array([[p.effects["delay"]["time"] / 1e-5, p.effects["mass"]["change"] / 0.1] for p in points])
        return u @ columns

    data = np.array([-5.0, 4.0]) @ columns
    fits = begin([delay], [np.array([1.0, 0.0])], data, simulate)
    iterate(fits, data, simulate, 12)
    alone = (columns[1] @ data.conj()).real / np.vdot(columns[1], columns[1]).real
    assert fits[0].u[0] == 0.0 and fits[0].u[1] == pytest.approx(alone, rel=1e-6) and fits[0].done


def test_the_form_of_a_lag_is_part_lag_part_delay():
    """Its share of the time passes as delay, within a prior, and not where a delay is fitted beside it."""
    h = Hypothesis(("amplifier_lag",), TOLERANCE)
    assert h.calibrated == (*TOLERANCE, FORM) and h.prior.tolist() == [0.0, 1.0, 1.0, 1.0]
    point = h.point(np.array([10.0, 0.0, 0.0, 0.3 / FORM_SHARE]))
    assert point.effects["amplifier_lag"]["time_constant"] == pytest.approx(7e-5)
    assert point.effects["delay"]["time"] == pytest.approx(3e-5) and FORM not in point.changes
    assert h.point(np.array([10.0, 0.0, 0.0, 0.0])).effects == effect("amplifier_lag", 1e-4)
    assert h.bounded(np.array([1.0, 0.0, 0.0, -1.0]))[3] == 0.0
    assert h.bounded(np.array([1.0, 0.0, 0.0, 99.0]))[3] * FORM_SHARE == MOST_FORM
    assert Hypothesis(("delay", "amplifier_lag"), TOLERANCE).calibrated == tuple(TOLERANCE)


@pytest.mark.slow
def test_standard_errors_cover_a_delay_beside_tolerances_that_are_off(tmp_path):
    """Each of 40 rigs has its own parameters within tolerance, and its own noise.

    The amplifier's lag has its stated form: with a form of its own, it is nearly a delay, and the cost has two minima.
    """
    rng, rig = np.random.default_rng(8), load_rig("hmb_free")
    allowed, truth, experiments = tolerances(rig), 3e-5, []
    base = planned(rig, names=("base",))[0].experiment
    for seed in range(40):
        off = {name: sigma * float(rng.standard_normal()) for name, sigma in allowed.items()}
        effects, parameters = effect("delay", truth), {}
        for name, change in off.items():
            if name in TOLERANCE_EFFECTS:
                effects[TOLERANCE_EFFECTS[name]] = {"change": change}
            else:
                parameters[name] = getattr(rig, name) * (1 + change)
        own = with_parameters(rig, parameters)
        experiments.append(replace(base, rig=own, effects=effects, seed=seed))
    pulls, sizes = [], []
    hypothesis = Hypothesis(("delay",), allowed)
    for record in repeated(tmp_path, experiments):
        problem = assemble([record], for_estimate=True)
        fits = begin([hypothesis], [np.r_[1.0, np.zeros(len(allowed))]], problem.data, problem.simulate)
        iterate(fits, problem.data, problem.simulate, 4)
        differentiate(fits, problem.data, problem.simulate, True)
        sd = np.sqrt(fits[0].covariance()[0, 0])
        pulls.append((hypothesis.point(fits[0].u).effects["delay"]["time"] / 1e-5 - truth / 1e-5) / sd)
        sizes.append(sd)
    assert 0.75 < np.std(pulls, ddof=1) < 1.25 and abs(np.mean(pulls)) < 3 / np.sqrt(40)
    assert np.mean(sizes) < 0.3 * truth / 1e-5  # the delay is measured, not guessed


def test_a_coordinate_that_is_known_to_the_last_digit_hides_none_of_the_others():
    rng = np.random.default_rng(5)
    rows = rng.standard_normal((4, 200)) * np.array([1e10, 1.0, 1e3, 1e-2])[:, None]
    scale = np.array([1e10, 1.0, 1e3, 1e-2])
    unscaled = np.linalg.inv((rows / scale[:, None]) @ (rows / scale[:, None]).T) / np.outer(scale, scale)
    assert inverse(rows @ rows.T) == pytest.approx(unscaled, rel=1e-6)
    unknown = np.pad(rows @ rows.T, (0, 1))  # a coordinate of which nothing is told
    assert inverse(unknown)[:4, :4] == pytest.approx(unscaled, rel=1e-6) and not inverse(unknown)[4].any()


def test_a_coordinate_that_nothing_tells_has_no_error_of_zero():
    jacobian = np.zeros((2, ROWS), complex)
    jacobian[0] = 1.0
    fit = Fit(Hypothesis(("actuator_gain", "damping"), {}), np.zeros(2), np.zeros(ROWS, complex), 0.0, jacobian)
    assert fit.spread == pytest.approx([ROWS**-0.5, NOT_TOLD])


def test_of_two_that_do_the_same_neither_is_told():
    rng = np.random.default_rng(6)
    same, own = rng.standard_normal((2, ROWS)) + 1j * rng.standard_normal((2, ROWS))
    h = Hypothesis(("actuator_gain", "damping", "mass"), {})
    fit = Fit(h, np.zeros(3), np.zeros(ROWS, complex), 0.0, np.array([same, same, own]))
    assert fit.spread[:2].tolist() == [NOT_TOLD] * 2 and fit.spread[2] < 1.0
    apart = Fit(h, np.zeros(3), np.zeros(ROWS, complex), 0.0, np.array([same, same + 1e-3 * own, own**2]))
    assert (fit.spread[2] < apart.spread[:2]).all() and (apart.spread < NOT_TOLD / 10).all()


@pytest.mark.parametrize(
    "order, sd, charged", [(0.98, 0.03, 0.0), (0.95, 0.03, 1 / 6), (0.97, 0.002, 1.0), (0.6, 0.03, 1.0)]
)
def test_a_further_parameter_is_charged_no_more_than_an_end_of_its_range_would_lose(order, sd, charged):
    h = Hypothesis(("eddy_current", "delay"), {})
    u = [c.at({"corner_hz": 1e3, "order": order, "time": 0.0}[c.parameter]) for c in h.coordinates]
    rows = np.diag([1.0, h.coordinates[1].scale / sd, 1e-3]).astype(complex)
    fit = Fit(h, np.array(u), np.zeros(3, complex), 7.0, rows)
    assert fit.charged == pytest.approx([1.0, charged, 1.0])  # a first one always is, also at its end
    assert Candidate(fit).predictive == pytest.approx(7.0 + 2.0 * (2 + charged))
    fit.jacobian = None
    assert fit.charged.all()
