"""What acts like an effect of the best pair is fitted in its place, whatever the rounds of the search chose."""

import numpy as np
import pytest
from bench_loop import Bench, write_campaign

from sim2real.compared.problem import assemble
from sim2real.recorded.records import read_records
from sim2real.search.exchanged import exchanged
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.pairs import _like_the_best
from sim2real.search.starts import starts


def test_a_lag_or_a_resonance_is_exchanged_for_another_one():
    lags = {"amplifier_lag", "sensor_lag", "eddy_current"}
    assert set(exchanged(("friction", "delay"))) == {frozenset({"friction", lag}) for lag in lags}
    assert frozenset({"mass", "support_resonance"}) in exchanged(("mass", "sensor_resonance"))
    assert exchanged(("mass", "friction")) == [frozenset({"sensor_gain", "friction"})]
    springs = exchanged(("force_law", "friction"))
    assert len(springs) == len(set(springs)) == 2  # one of them is like it, too
    assert all(len(pair) == 2 for pair in exchanged(("delay", "sensor_lag")))  # none twice


@pytest.mark.slow
def test_beside_another_gain_every_lag_is_fitted_where_one_was(tmp_path):
    folder = write_campaign(tmp_path, Bench(gain=-0.1, delay=30e-6), {"noise": "fit"}, 0.5, 0)
    problem = assemble(read_records(folder)[1])
    data, simulate = problem.data, problem.simulate
    names = ("actuator_gain", "delay", "amplifier_lag", "sensor_lag")

    def begun(*names):
        h, u = Hypothesis(names, {}), np.concatenate([starts(n)[0] for n in names])
        return begin([h], [np.pad(u, (0, h.size - u.size))], data, simulate)[0]

    singles = [begun(n) for n in names]
    iterate(singles, data, simulate, 10)
    pair = begun("actuator_gain", "amplifier_lag")
    iterate([pair], data, simulate, 10)
    differentiate([pair], data, simulate, True)
    found = _like_the_best(problem, singles, [pair])
    assert {frozenset(f.hypothesis.effects) for f in found} == {
        frozenset({"actuator_gain", lag}) for lag in ("delay", "sensor_lag")
    }
    delay = next(f for f in found if "delay" in f.hypothesis.effects)
    assert delay.cost < pair.cost  # as the bench has it
    assert delay.hypothesis.point(delay.u).effects["delay"]["time"] == pytest.approx(30e-6, rel=0.1)
