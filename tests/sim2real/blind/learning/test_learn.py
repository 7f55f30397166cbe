"""A judge that learns, on evidence drawn from what it shall find out."""

import json
from dataclasses import replace

import numpy as np
import pytest
from drawn_evidence import drawn, examples
from scipy.special import expit, logit

from maglev_env.rig.rig_file import load_rig
from sim2real.blind.benchmark.rigs import draw_rig
from sim2real.blind.cases import Answer, Case, Hypothesis
from sim2real.blind.judging.judging import merged
from sim2real.blind.learning import learn as learn_module
from sim2real.blind.learning.examples import family_of, truth_of
from sim2real.blind.learning.learn import (
    UNKNOWN,
    _mass_before_truth,
    _reached,
    _told,
    judge_of,
    learn,
    log_score,
    rightness,
)  # fmt: skip
from sim2real.judgement.belief import LEVEL, Judge, judge_from, shipped
from sim2real.judgement.evidence_json import evidence_from_json, evidence_to_json
from sim2real.judgement.judge import Entry, entries
from sim2real.judgement.likely import as_right, as_sure, likely_in_words, likely_of, rareness

ROUNDS = 24  # of the search, which are fewer than in use


@pytest.fixture(scope="module")
def learned():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learn_module, "ROUNDS", ROUNDS)
        return learn(examples(80, 1), Judge())


@pytest.mark.slow
def test_what_was_learned_tells_more_of_what_it_has_not_seen(learned):
    """On fresh draws: the truth is more probable, and the set holds it as often as it says."""
    fresh = examples(600, 2)
    assert log_score(fresh, learned.judge) > log_score(fresh, Judge())
    assert learned.error[0] < learned.error[1]  # also of families that were left out
    held = [
        e.truth in [frozenset(names) if (names := h.effects) != ("calibration",) else frozenset({"none"}) for h in kept]
        for e in fresh
        for kept in [likely_of(e.found(learned.judge), e.evidence, learned.judge)]
    ]
    assert np.mean(held) == pytest.approx(LEVEL, abs=0.05)


@pytest.mark.slow
def test_the_p_value_of_a_known_cause_is_uniform_under_one(learned):
    known = [e for e in examples(800, 3) if e.truth not in ({"unknown"}, {"none"})]
    p = np.array([rareness(e.evidence, learned.judge)[0] for e in known])
    assert np.mean(p <= 0.1) < 0.14
    unknown = [e for e in examples(800, 4) if e.truth == {"unknown"}]
    rare = [rareness(e.evidence, learned.judge)[0] for e in unknown]
    assert np.mean(np.array(rare) <= 0.1) > 2 * np.mean(p <= 0.1)


@pytest.mark.slow
def test_the_same_examples_give_the_same_judge(learned):
    lesson, plain = examples(80, 1), Judge()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learn_module, "ROUNDS", ROUNDS)
        once, again = (judge_of(lesson, plain) for _ in range(2))
    assert json.dumps(once.to_json()) == json.dumps(again.to_json()) and once.belief != plain.belief
    # And that of the whole lesson, whose belief stays where a learned one is no better on what was left out.
    whole = learned.judge
    told = once if whole.belief != plain.belief else judge_of(lesson, plain, free=False)
    assert json.dumps(replace(told, reached=whole.reached).to_json()) == json.dumps(whole.to_json())
    assert judge_from(json.loads(json.dumps(whole.to_json()))) == whole


def test_evidence_is_the_same_after_json():
    e = drawn(np.random.default_rng(5), "delay", 500.0, 25.0)
    e = replace(e, cost=np.where(np.arange(e.cost.size) == 2, np.inf, e.cost), tones={"pickup": 3.0}, nameless=640.0)
    again = evidence_from_json(json.loads(json.dumps(evidence_to_json(e))))
    assert [(h.effects, h.probability) for h in entries(e)] == [(h.effects, h.probability) for h in entries(again)]
    assert again.groups == e.groups and np.array_equal(again.cost, e.cost) and again.nameless == 640.0


def test_trust_makes_probabilities_less_sure_and_keeps_their_order():
    e = drawn(np.random.default_rng(6), "delay", 500.0, 25.0)
    plain, doubted = (entries(e, Judge(trust={"displacement": t})) for t in (1.0, 0.5))
    assert doubted[0].probability < plain[0].probability
    assert [h.effects for h in doubted] == [h.effects for h in plain]


def test_the_shipped_judge_says_what_made_it():
    judge = shipped()
    assert judge.made_by["command"].startswith("maglev blind learn ")
    assert set(judge.trust) == set(judge.reached) == set(judge.left) == {"current", "displacement"}


@pytest.mark.parametrize("broken", [{"scatter": None}, {"groups": [1, 2]}, {"cost": [1.0]}, {"causes": 3}])
def test_evidence_that_is_none_is_refused(broken):
    data = json.loads(json.dumps(evidence_to_json(drawn(np.random.default_rng(5), "delay", 500.0, 25.0))))
    with pytest.raises(ValueError, match="evidence cannot be read"):
        evidence_from_json({**data, **broken})
    with pytest.raises(ValueError, match="KeyError: 'effects'"):
        evidence_from_json({name: value for name, value in data.items() if name != "effects"})


def test_a_judge_of_another_schema_is_refused():
    with pytest.raises(ValueError, match="judge: schema 'x' is not maglev-judge/1"):
        judge_from({"schema": "x"})


def test_the_first_hypothesis_is_the_one_that_is_scored():
    """None and calibration are one, which may be first only together."""
    judge = Judge()
    for e in examples(60, 2):
        which = tuple(Hypothesis(frozenset(h.effects), h.probability, {}) for h in e.found(judge))
        scored = merged(Answer(None, "no_gap", (), which, {}, 0.0, 0.0, ""))[0]
        probability, right, _ = _told(e, judge)
        assert (probability, bool(right)) == (pytest.approx(scored[1]), scored[0] == e.truth)


@pytest.mark.parametrize(("lacking", "says"), [(0, True), (3, True), (12, False)])
def test_a_set_is_said_only_where_it_can_hold_the_truth(lacking, says):
    """No set holds a truth that is not among the hypotheses, however many it has."""
    lesson = [replace(e, truth=frozenset({"gain_drift"})) if n < lacking else e for n, e in enumerate(examples(60, 7))]
    reached = _reached([_mass_before_truth(e, Judge()) for e in lesson])
    judge = Judge(reached={"displacement": reached})
    kept = likely_of(lesson[0].found(judge), lesson[0].evidence, judge)
    assert bool(kept) == says and json.dumps(judge.to_json(), allow_nan=False)
    assert any("no set of hypotheses" in sentence for sentence in likely_in_words(kept, None)) != says


@pytest.mark.parametrize("refuted", [False, True])
def test_an_unknown_cause_is_no_surer_than_it_was_right(refuted):
    """What the holdout refuted is what else it may have been."""
    before = [Entry(("unknown",), 0.98, 1.0, None, None), Entry(("delay",), 0.02, 2.0, 1, None)]
    after = [replace(e, probability=p) for e, p in zip(before, (1.0, 0.0), strict=True)] if refuted else before
    found = as_sure(after, before, Judge(surest=0.93))
    assert [e.effects for e in found] == [("unknown",), ("delay",)]
    assert [e.probability for e in found] == pytest.approx([0.93, 0.07])
    assert as_sure(after, before, Judge()) == after
    hardly = [replace(e, probability=p) for e, p in zip(before, (1.0, 5e-324), strict=True)]
    assert [e.probability for e in as_sure(hardly, hardly, Judge(surest=0.93))] == pytest.approx([0.93, 0.07])
    named = [replace(e, probability=p) for e, p in zip(before, (0.4, 0.6), strict=True)]
    assert as_sure(named, before, Judge(surest=0.93)) == named


def listed(**probabilities):
    """Hypotheses by name, the most probable first."""
    found = [Entry((name,), p, 1.0, None, None) for name, p in probabilities.items()]
    return sorted(found, key=lambda e: -e.probability)


def test_the_first_hypothesis_is_as_probable_as_it_was_right():
    judge = Judge(right=(-0.5, 1.0))
    named = as_right(listed(delay=0.8, mass=0.15, none=0.05), judge)
    assert [e.effects[0] for e in named] == ["delay", "mass", "none"]
    assert named[0].probability == pytest.approx(1 / (1 + np.exp(0.5) / 4))
    assert named[1].probability / named[2].probability == pytest.approx(3.0)
    near = as_right(listed(delay=0.51, mass=0.48, none=0.01), judge)  # no other one becomes more probable
    assert near[0].effects == ("delay",) and near[0].probability == pytest.approx(near[1].probability)
    for found in (named, near):
        assert sum(e.probability for e in found) == pytest.approx(1.0)
    clear, whole = listed(delay=0.4, calibration=0.35, none=0.25), listed(unknown=1.0, mass=0.0)
    assert as_right(clear, judge) == clear and as_right(whole, judge) == whole
    assert [e.probability for e in as_right(named, Judge())] == pytest.approx([e.probability for e in named])


def test_how_often_the_first_hypothesis_is_right_is_learned_from_what_was_told():
    rng = np.random.default_rng(5)
    stated = rng.uniform(0.3, 0.99, 6000)
    right = rng.uniform(size=stated.size) < expit(-0.5 + 0.9 * logit(stated))
    firsts = [(frozenset({"delay"}), p, bool(r)) for p, r in zip(stated, right, strict=True)]
    nothing = [(frozenset({"none"}), 0.9, False)] * 1000  # which is not asked
    assert rightness([*firsts, *nothing]) == pytest.approx((-0.5, 0.9), abs=0.08)
    assert rightness(nothing) == (0.0, 1.0)


@pytest.mark.parametrize(("p", "speaks"), [(0.03, True), (0.6, False)])
def test_what_is_not_rare_for_a_known_cause_is_said_to_speak_for_none(p, speaks):
    (said,) = likely_in_words(listed(unknown=0.9), (p, 100))
    assert said.startswith(f"p-value of a known cause: {p}") and ("not what is left speaks" in said) != speaks


def test_how_sure_an_unknown_cause_may_be_is_counted(monkeypatch):
    """Nine of ten that were nearly certain, and by chance more: (9 + 1) / (10 + 2)."""
    sure = [Entry(("unknown",), 0.99, 1.0, None, None)]
    monkeypatch.setattr(learn_module.Example, "found", lambda self, judge: sure)
    lesson = [replace(e, truth=UNKNOWN if n else frozenset({"delay"})) for n, e in enumerate(examples(10, 7))]
    assert learn_module._surest(lesson, Judge()) == pytest.approx(10 / 12)


def test_of_channels_that_taught_nothing_no_set_is_said():
    e = examples(1, 1)[0]
    assert likely_of(e.found(Judge()), e.evidence, Judge()) == []


def test_a_truth_has_one_family(tmp_path):
    """On a ball a negative stiffness is a force law, so that leaving one of them out must leave out the other."""
    (tmp_path / "rig.toml").write_text(draw_rig("ball", np.random.default_rng(0)).toml())
    rig = load_rig(tmp_path / "rig.toml")

    def found(*effects):
        case = Case("c1", "single", "ball", "full", frozenset(effects), 20.0, frozenset({0.0}), {})
        return family_of(case, rig), truth_of(case, rig)

    assert found("negative_stiffness") == found("force_law") == ("force_law", {"force_law"})
    assert found("negative_stiffness", "delay") == found("force_law", "delay")


def test_too_few_families_are_refused():
    with pytest.raises(ValueError, match="examples of 1 families"):
        learn([examples(1, 1)[0]], Judge())
