"""One cause without a name, or two with one."""

from types import SimpleNamespace

import numpy as np
import pytest

import sim2real.judgement.named as named_module
import sim2real.judgement.one_cause as module
from sim2real.free.kinds import CURVE, LINEAR, PLAY, Freed, Kind
from sim2real.judgement.judge import Entry
from sim2real.search.hypotheses import Hypothesis

SPRING = Kind("free_spring", CURVE)
PAIR = ("support_resonance", "cubic_spring")


def fit(hypothesis, cost):
    return SimpleNamespace(hypothesis=hypothesis, cost=cost, u=np.zeros(1))


def attribution_of(effects):
    calibration = SimpleNamespace(fit=fit(Hypothesis((), {"mass": 0.01}), 900.0))
    problem = SimpleNamespace(data=np.zeros(0), simulate=None)
    best = SimpleNamespace(fit=fit(Hypothesis(effects, {"mass": 0.01}), 200.0))
    return SimpleNamespace(calibration=calibration, candidates=[calibration, best], problem=problem)


def tried(monkeypatch, of_one, fitted=205.0, effects=PAIR):
    """With what one correction costs on all recordings, where a pair costs 400, and on the fitted ones, where it costs
    200."""
    freed = fit(Freed((), {"mass": 0.01}, added=(SPRING,)), fitted)
    monkeypatch.setattr(module, "sizes_of", lambda *a: SimpleNamespace())
    monkeypatch.setattr(module, "kinds", lambda *a: (SPRING,))
    monkeypatch.setattr(module, "looked_at", lambda problem, base, able, *a: [(0.0, freed) for _ in able])
    monkeypatch.setattr(module, "iterate", lambda *a: None)
    monkeypatch.setattr(module, "_of_all", lambda p, j, fits: [of_one if f is freed else 400.0 for f in fits])
    return module.explained_by_one(None, attribution_of(effects), [Entry(effects, 0.8, 200.0, 1, None)])


def test_one_correction_that_does_as_well_as_two_effects_is_one_cause_without_a_name(monkeypatch):
    """A seal on one side, which a spring that hardens on both sides and a mode make up for."""
    assert tried(monkeypatch, 396.0) == "mechanics"
    assert tried(monkeypatch, 420.0) == "mechanics"
    assert tried(monkeypatch, 660.0) is None
    assert tried(monkeypatch, 396.0, fitted=300.0) is None  # the fitted recordings ask for both


def test_a_single_effect_never_competes_with_a_correction(monkeypatch):
    assert tried(monkeypatch, 0.0, effects=("cubic_spring",)) is None
    tone = [Entry(("cubic_spring", "unbalance"), 0.8, 200.0, 1, None)]
    assert module.explained_by_one(None, attribution_of(("cubic_spring",)), tone) is None
    tones = [Entry(("pickup", "unbalance"), 0.8, 200.0, None, None)]
    assert module.explained_by_one(None, attribution_of(PAIR), tones) is None
    assert module.explained_by_one(None, None, []) is None


def test_a_pair_that_is_one_curve_is_not_asked(monkeypatch):
    assert tried(monkeypatch, 0.0, effects=("negative_stiffness", "cubic_spring")) is None


@pytest.mark.parametrize(
    ("effects", "kind", "more"),
    [
        (PAIR, SPRING, True),
        (("cubic_spring", "damping"), SPRING, False),
        (("soft_stop", "negative_stiffness"), SPRING, False),
        (("amplifier_lag", "saturation"), Kind("free_command", CURVE), True),
        (PAIR, Kind("free_spring", LINEAR), True),
        (("amplifier_lag", "negative_stiffness"), Kind("free_spring", LINEAR), False),
        (("hysteresis", "actuator_gain"), Kind("free_current", PLAY), False),
    ],
)
def test_two_effects_are_more_than_a_curve_if_one_lags_and_than_a_filter_if_one_is_bent(effects, kind, more):
    assert module.is_more_than(effects, kind) == more


@pytest.mark.parametrize(("block", "verdict"), [(None, "explained"), ("mechanics", "unexplained")])
def test_a_pair_that_one_cause_explains_is_not_named(monkeypatch, block, verdict):
    found = [Entry(PAIR, 0.9, 100.0, 1, None), Entry(("unknown",), 0.1, 101.0, None, None)]
    monkeypatch.setattr(named_module, "borne_out", lambda judged, attribution, kept: list(kept))
    for name in ("spoken_against", "leaves_too_much"):
        monkeypatch.setattr(named_module, name, lambda *a: [])
    monkeypatch.setattr(named_module, "_predicts_nothing", lambda *a: False)
    monkeypatch.setattr(named_module, "explained_by_one", lambda *a: block)
    weighed = SimpleNamespace(found=found, verdict="explained", cause=PAIR, evidence=None, tempering=1.0)
    named = named_module.by_holdout(None, None, "holdout", None, weighed)
    assert named.verdict == verdict
    assert [e.effects for e in named.kept] == ([PAIR] if block is None else [])
    assert named.found[0].effects == (PAIR if block is None else ("unknown",))
    assert any("one cause without a name" in note for note in named.notes) == (block is not None)
