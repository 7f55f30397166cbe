"""The verdict where the holdout refutes all that is named."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.judgement import named as module
from sim2real.judgement.judge import Entry
from sim2real.search.hypotheses import Hypothesis


def entries(calibration, unknown):
    rest = [Entry(("calibration",), calibration, 108.0, 0, None), Entry(("unknown",), unknown, 100.0, None, None)]
    return [Entry(("damping",), 0.6, 100.0, 1, None), *sorted(rest, key=lambda e: -e.probability)]


@pytest.mark.parametrize(
    ("calibration", "unknown", "verdict"),
    [(0.3, 0.1, "no_gap"), (0.05, 0.35, "unexplained"), (0.0, 0.4, "unexplained")],
)
def test_what_is_left_decides(monkeypatch, calibration, unknown, verdict):
    """Where calibration is then the most probable, nothing is missing."""
    monkeypatch.setattr(module, "borne_out", lambda *a: [])
    monkeypatch.setattr(module, "shows_nothing", lambda *a: False)
    evidence = SimpleNamespace(cost=np.array([108.0, 100.0]))
    weighed = SimpleNamespace(
        found=entries(calibration, unknown), verdict="explained", cause=("damping",), evidence=evidence
    )
    named = module.by_holdout(None, None, "holdout", None, weighed)
    assert (named.verdict, named.cause) == (verdict, () if verdict == "no_gap" else ("unknown",))
    assert not named.kept and any("not named" in note for note in named.notes)
    assert sum(e.probability for e in named.found) == pytest.approx(1.0)


@pytest.mark.parametrize("clear", [False, True])
def test_what_the_holdout_shows_is_named_where_it_leaves_no_clear_gap(monkeypatch, clear):
    """An offset that the fitted recordings did not tell from none explained a third of the gap of a holdout."""
    found = [Entry(("calibration",), 0.8, 100.0, 0, None), Entry(("unknown",), 0.1, 100.0, None, None)]
    found.append(Entry(("actuator_offset",), 0.1, 102.0, 1, None))
    monkeypatch.setattr(module, "shown_by_both", lambda *a: found[2:])
    monkeypatch.setattr(module, "leaves_clear_gap", lambda *a: clear)
    weighed = SimpleNamespace(found=found, verdict="no_gap", cause=(), evidence=None, tempering=1.0)
    monkeypatch.setattr(module, "_predicts_nothing", lambda *a: False)
    named = module.by_holdout(None, None, "holdout", None, weighed)
    probability = {e.effects: e.probability for e in named.found}
    if clear:
        assert (named.verdict, named.cause, named.kept) == ("unexplained", ("unknown",), [])
        assert probability[("unknown",)] == pytest.approx(0.5) and probability[("calibration",)] == 0.0
    else:
        assert (named.verdict, named.cause) == ("explained", ("actuator_offset",))
        assert probability == pytest.approx({("actuator_offset",): 0.9, ("unknown",): 0.1, ("calibration",): 0.0})


@pytest.mark.parametrize("fails", [False, True])
def test_where_calibration_fails_on_the_holdout_something_is_unknown(monkeypatch, fails):
    """A tilted target passed for noise of recordings without a period; of the holdout it left 1.8 times the noise."""
    found = [Entry(("calibration",), 0.8, 100.0, 0, None), Entry(("unknown",), 0.15, 100.0, None, None)]
    found.append(Entry(("cogging",), 0.05, 102.0, 1, None))
    monkeypatch.setattr(module, "shown_by_both", lambda *a: [])
    monkeypatch.setattr(module, "calibration_fails", lambda *a: fails)
    weighed = SimpleNamespace(found=found, verdict="no_gap", cause=(), evidence=None, tempering=1.0)
    named = module.by_holdout(None, None, "holdout", None, weighed)
    assert named.verdict == ("unexplained" if fails else "no_gap")
    first = named.found[0]
    assert (first.effects[0], first.probability) == pytest.approx(("unknown", 0.75) if fails else ("calibration", 0.8))


def test_what_is_much_less_probable_than_calibration_is_not_named_because_others_are_refuted(monkeypatch):
    """Four lags together were more probable than calibration, and the holdout spoke against the first three."""
    found = [
        Entry(("calibration",), 0.3, 100.0, 0, None), Entry(("amplifier_lag",), 0.25, 99.0, 1, None),
        Entry(("delay",), 0.25, 99.0, 2, None), Entry(("eddy_current",), 0.1, 99.0, 3, None),
        Entry(("unknown",), 0.1, 100.0, None, None),
    ]  # fmt: skip
    monkeypatch.setattr(module, "borne_out", lambda *a: [found[3]])
    monkeypatch.setattr(module, "spoken_against", lambda *a: [])
    monkeypatch.setattr(module, "leaves_too_much", lambda *a: [])
    monkeypatch.setattr(module, "_predicts_nothing", lambda *a: False)
    weighed = SimpleNamespace(found=found, verdict="ambiguous", cause=(), evidence=None, tempering=1.0)
    named = module.by_holdout(None, None, "holdout", None, weighed)
    assert (named.verdict, named.cause, named.kept) == ("no_gap", (), [])
    assert named.found[0].effects == ("calibration",)


@pytest.mark.parametrize(("predicted", "named"), [(0.02, True), (0.0, False), (-3.0, False)])
def test_what_predicts_nothing_of_the_motion_is_not_named(monkeypatch, predicted, named):
    monkeypatch.setattr(module, "figures", lambda problem, residual: SimpleNamespace(predicted=predicted))
    fit = SimpleNamespace(hypothesis=Hypothesis(("cubic_spring",), {}), residual=None)
    attribution = SimpleNamespace(candidates=[None, SimpleNamespace(fit=fit)])
    entry = SimpleNamespace(candidate=1, effects=("cubic_spring",))
    assert module._predicts_nothing(None, attribution, entry) is not named
    tone = SimpleNamespace(candidate=None, effects=("unbalance",))
    assert not module._predicts_nothing(None, attribution, tone)


@pytest.mark.parametrize(
    ("of_next", "borne", "verdict"),
    [(0.04, True, "explained"), (0.04, False, "unexplained"), (0.004, True, "unexplained")],
)
def test_what_is_named_instead_is_asked_on_the_holdout_too(monkeypatch, of_next, borne, verdict):
    """The holdout refuted a lag, which left a delay more probable than an unknown cause."""
    found = [Entry(("amplifier_lag",), 0.99 - of_next, 100.0, 1, None), Entry(("delay",), of_next, 101.0, 2, None)]
    found.append(Entry(("unknown",), 0.003, 100.0, None, None))
    asked = []

    def bears_out(judged, attribution, named):
        asked.extend(e.effects[0] for e in named)
        return [e for e in named if borne and e.effects == ("delay",)]

    monkeypatch.setattr(module, "borne_out", bears_out)
    for name in ("spoken_against", "leaves_too_much"):
        monkeypatch.setattr(module, name, lambda *a: [])
    for name in ("shows_nothing", "_predicts_nothing"):
        monkeypatch.setattr(module, name, lambda *a: False)
    evidence = SimpleNamespace(cost=np.array([200.0, 100.0, 101.0]))
    weighed = SimpleNamespace(found=found, verdict="explained", cause=("amplifier_lag",), evidence=evidence)
    named = module.by_holdout(None, None, "holdout", None, weighed)
    assert named.verdict == verdict and [e.effects for e in named.kept] == [("delay",)] * (verdict == "explained")
    assert asked == ["amplifier_lag"] + ["delay"] * (of_next > module.LEAST)
    assert named.effects[0].effects == (("delay",) if verdict == "explained" else ("amplifier_lag",))
