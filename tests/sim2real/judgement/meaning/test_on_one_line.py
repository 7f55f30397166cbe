"""On how many lines a resonance acts: one that explains a single line is no evidence of a resonance."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.compared.point import Point
from sim2real.judgement.evidence import as_good_as_others
from sim2real.judgement.meaning.on_one_line import FLANKS, LINES, acts_on_one_line, flanks, lines_of
from sim2real.search.fitting import begin
from sim2real.search.hypotheses import Hypothesis

LOW, HIGH = (5.0, 15.0, 25.0, 35.0, 45.0), 2  # lines, Hz, and how many recordings have them
MODE = Hypothesis(("sensor_resonance",), {})


@dataclass(frozen=True)
class Bench:
    """The response of one mode at few lines of two recordings."""

    data: np.ndarray

    @property
    def parts(self):
        record = SimpleNamespace(frequency=np.array(LOW), lines=np.array(LOW) / 5)
        used, measured = np.ones(len(LOW), bool), np.zeros((1, 1, len(LOW)))
        return [
            SimpleNamespace(record=record, used=used, measured=measured, place=slice(i * len(LOW), (i + 1) * len(LOW)))
            for i in range(HIGH)
        ]

    def simulate(self, points):
        return np.array([np.tile(response(p), HIGH) for p in points])


def response(point):
    mode = point.effects.get("sensor_resonance")
    if mode is None:
        return np.zeros(len(LOW), complex)
    x = np.array(LOW) / mode["frequency"]
    return 100 * mode["coupling"] * x**2 / (1 - x**2 + 2j * mode["damping_ratio"] * x)


def fit(frequency, damping):
    u = np.array([np.log(frequency), np.log(damping), 1.0])
    b = Bench(np.tile(response(MODE.point(u)), HIGH))
    return b, begin([MODE], [u], b.data, b.simulate)[0]


def test_a_narrow_mode_at_a_line_acts_on_that_line_alone():
    assert acts_on_one_line(*fit(25.05, 0.003))
    assert not acts_on_one_line(*fit(20.0, 0.1))  # between two lines: both answer, and the others
    assert not acts_on_one_line(*fit(25.0, 0.5))


@pytest.mark.parametrize(("size", "alone"), [(0.3, True), (3.0, False)])
def test_the_flanks_of_a_strong_mode_show_on_the_other_lines(size, alone):
    """The same mode, whose flanks are lost in noise of variance one or stand out of it."""
    b, one = fit(25.05, 0.003)
    b = Bench(b.data * size)
    strong = replace(one, residual=one.residual * size, jacobian=np.zeros((3, b.data.size), complex), cost=0.0)
    change = -b.data
    assert (flanks(b, strong, "sensor_resonance", change) < FLANKS) == alone
    beside = np.delete(b.data.reshape(HIGH, -1), 2, axis=1)
    assert flanks(b, strong, "sensor_resonance", change) == pytest.approx(np.sum(abs(beside) ** 2))


def test_a_hypothesis_without_a_resonance_acts_as_it_does():
    b, _ = fit(25.05, 0.003)
    (delay,) = begin([Hypothesis(("delay",), {})], [np.array([1.0])], b.data, b.simulate)
    assert not acts_on_one_line(b, delay)


def test_lines_are_counted_by_power_and_those_of_all_recordings_together():
    b, _ = fit(20.0, 0.1)
    one = np.zeros(len(LOW) * HIGH, complex)
    one[[2, 2 + len(LOW)]] = 3.0, 4j  # the same line in both recordings
    assert lines_of(b, one) == pytest.approx(1.0) and LINES > 1.0
    assert lines_of(b, np.ones_like(one)) == pytest.approx(len(LOW))
    assert lines_of(b, 0 * one) == 0.0
    assert b.simulate([Point({}, {})]).shape == (1, len(LOW) * HIGH)


RIVALS = [("support_resonance", 2.0, True), ("support_resonance", 20.0, False), ("delay", 2.0, False)]


@pytest.mark.parametrize(("other", "more", "kept"), RIVALS)
def test_a_resonance_on_one_line_stays_beside_another_one_that_explains_no_more(other, more, kept):
    """A mode that shows beside a line may be that of the probe or of the support, wherever the fit of each puts it."""
    attribution = SimpleNamespace(candidates=[SimpleNamespace(effects=(n,)) for n in ("sensor_resonance", other)])
    cost = np.array([np.inf, 531.0 + more])
    assert as_good_as_others(attribution, cost, {0: 531.0}) == ([0] if kept else [])
