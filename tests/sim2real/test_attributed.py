"""The noise that the best fit leaves, on a linear problem."""

from types import SimpleNamespace

import numpy as np

from sim2real.attributed import _with_noise_of_best
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fitting import begin
from sim2real.search.hypotheses import Hypothesis


def test_the_best_fit_may_be_one_that_was_only_simulated():
    """It was far behind under the noise before, so that its derivatives were not computed again."""
    rng = np.random.default_rng(2)
    row = rng.standard_normal(50) + 1j * rng.standard_normal(50)
    problem = SimpleNamespace(
        data=0.02 * row,
        parts=(),
        simulate=lambda points: np.array([p.changes["mass"] * row for p in points]),
        again=lambda near, louder, records: (near, louder),
    )
    h = Hypothesis((), {"mass": 0.01})
    (fit,) = begin([h], [np.array([2.0])], problem.data, problem.simulate)
    assert fit.jacobian is None
    attribution = Attribution(0.0, (Candidate(fit),), 100.0, problem)
    (near, _), _, louder = _with_noise_of_best(problem, problem, attribution)
    assert near.changes == {"mass": 0.02} and louder == 1.0
