"""A judge that learns, on evidence drawn from what it shall find out."""

import json
from dataclasses import replace

import numpy as np
import pytest

from maglev_env.rig.rig import load_rig
from sim2real.blind.learning import learn as learn_module
from sim2real.blind.learning.examples import Example
from sim2real.blind.learning.learn import learn, log_score
from sim2real.judgement.belief import LEVEL, Judge, judge_from, shipped
from sim2real.judgement.dispersion import ChiSquare, Dispersion
from sim2real.judgement.evidence import Evidence
from sim2real.judgement.evidence_json import evidence_from_json, evidence_to_json
from sim2real.judgement.judge import entries
from sim2real.judgement.likely import likely_of, rareness

RIG = load_rig("hmb_free")
NAMES = ("delay", "damping", "mass", "friction", "saturation", "amplifier_lag")
GROUPS = (("plant", "force", 16.0), ("plant", "force", 32.0))


def drawn(rng, truth: str, gap: float, apart: float) -> Evidence:
    """Costs of a campaign: the truth is the best but for noise, and the others are apart by about so much."""
    cost = 200.0 + gap + np.concatenate([[0.0], -gap + apart * rng.exponential(size=len(NAMES))])
    if truth in NAMES:
        cost[1 + NAMES.index(truth)] = 200.0 + 10 * rng.exponential()
    unknown = truth == "unknown"
    left = np.where(np.isin(["", *NAMES], [truth]), 0.0, cost - 200.0) + (150.0 * rng.exponential() if unknown else 0.0)
    excess = np.repeat(left[:, None] / 2, 2, axis=1)
    chi = ChiSquare(200.0 + left.min(), 200.0, 1.5)
    effects = ((), *((name,) for name in NAMES))
    return Evidence(
        effects, cost, 200.0 + gap, excess, np.full(2, 20.0), GROUPS, {}, {}, {}, Dispersion(chi, chi), np.zeros(7)
    )


def examples(n: int, seed: int) -> list[Example]:
    rng = np.random.default_rng(seed)
    found = []
    for i in range(n):
        truth = str(rng.choice([*NAMES, "none", "unknown"]))
        gap = 0.0 if truth == "none" else 10 ** rng.uniform(1.5, 4)
        family = f"{truth} {i % 8}" if truth in ("none", "unknown") else truth
        found.append(Example(family, frozenset({truth}), drawn(rng, truth, gap, 25.0), RIG))
    return found


def taught():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learn_module, "ROUNDS", 40)
        return learn(examples(100, 1), Judge())


@pytest.fixture(scope="module")
def learned():
    return taught()


@pytest.mark.slow
def test_what_was_learned_tells_more_of_what_it_has_not_seen(learned):
    """On fresh draws: the truth is more probable, and the set holds it as often as it says."""
    fresh = examples(600, 2)
    assert log_score(fresh, learned.judge) > log_score(fresh, Judge())
    assert learned.score[0] > learned.score[1]
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
    again = taught()
    assert json.dumps(again.judge.to_json()) == json.dumps(learned.judge.to_json())
    assert judge_from(json.loads(json.dumps(again.judge.to_json()))) == learned.judge


def test_evidence_is_the_same_after_json():
    e = drawn(np.random.default_rng(5), "delay", 500.0, 25.0)
    e = replace(e, cost=np.where(np.arange(e.cost.size) == 2, np.inf, e.cost), tones={"pickup": 3.0})
    again = evidence_from_json(json.loads(json.dumps(evidence_to_json(e))))
    assert [(h.effects, h.probability) for h in entries(e)] == [(h.effects, h.probability) for h in entries(again)]
    assert again.groups == e.groups and np.array_equal(again.cost, e.cost)


def test_trust_makes_probabilities_less_sure_and_keeps_their_order():
    e = drawn(np.random.default_rng(6), "delay", 500.0, 25.0)
    plain, doubted = (entries(e, Judge(trust={"displacement": t})) for t in (1.0, 0.5))
    assert doubted[0].probability < plain[0].probability
    assert [h.effects for h in doubted] == [h.effects for h in plain]


def test_the_shipped_judge_says_what_made_it():
    judge = shipped()
    assert judge.made_by["command"].startswith("maglev blind learn ")
    assert set(judge.trust) == set(judge.reached) == set(judge.left) == {"current", "displacement"}


def test_a_judge_of_another_schema_is_refused():
    with pytest.raises(ValueError, match="judge: schema 'x' is not maglev-judge/1"):
        judge_from({"schema": "x"})


def test_too_few_families_are_refused():
    with pytest.raises(ValueError, match="examples of 1 families"):
        learn([examples(1, 1)[0]], Judge())
