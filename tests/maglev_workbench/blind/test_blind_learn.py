"""`maglev blind learn` as a user runs it: a set made and answered by hand, and the judge that it teaches."""

import json
from hashlib import sha256

import pytest
from command_line import maglev
from drawn_evidence import examples

import sim2real
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.rig_toml import rig_toml
from maglev_lanes.code_version import DIAGNOSING, code_version
from sim2real.blind.benchmark import generate as generator
from sim2real.blind.learning import learn
from sim2real.judgement.belief import judge_from

DRAWN = examples(40, 9)
UNKNOWN = ("cogging", "fluid_whirl", "cable_creep")


class Said:
    """A diagnosis with drawn evidence."""

    def __init__(self, campaign):
        self.evidence = DRAWN[int(campaign.name[1:])].evidence

    def to_json(self):
        which = [{"effects": ["none"], "probability": 1.0, "parameters": {}}]
        where, gap = {"blocks": {"controller": 1.0}}, {"closed_fraction": 0.9}
        return {
            "schema": "maglev-diagnosis/1",
            "verdict": "no_gap",
            "cause": [],
            "where": where,
            "which": which,
            "gap": gap,
        }


def made_by_hand(folder, count, seed, processes, labels, oracle, advance=None):
    """What the generator would write, without a single sample."""
    assert not oracle
    rows = []
    for i in range(count):
        campaign = folder / f"c{i:04d}"
        campaign.mkdir(parents=True)
        (campaign / "campaign.toml").write_text("[[recording]]\nspeed_rpm = 0.0\n")
        (campaign / "rig.toml").write_text(rig_toml(load_rig("hmb_free")))
        (truth,) = DRAWN[i].truth
        kind = truth if truth in ("none", "unknown") else "single"
        effects = {} if kind == "none" else {UNKNOWN[i % 3] if kind == "unknown" else truth: {}}
        row = {"id": campaign.name, "kind": kind, "effects": effects, "sizes": [5.0] * len(effects), "rig": "rotor"}
        rows.append(row | {"channels": "displacement"})
    labels.write_text(json.dumps(rows))
    return sha256(labels.read_bytes()).hexdigest()


@pytest.mark.slow
def test_a_judge_is_made_and_made_again_to_the_last_byte(tmp_path, monkeypatch):
    monkeypatch.setattr(sim2real, "diagnose", Said, raising=False)
    monkeypatch.setattr(generator, "generate", made_by_hand)
    monkeypatch.setattr(learn, "ROUNDS", 12)
    arguments = ("--seed", 3, "--count", 40, "--processes", 1)
    text = maglev("blind", "learn", tmp_path / "s", *arguments, "--out", tmp_path / "one.json")
    assert "40 campaigns" in text and "hypotheses in a 90 % set" in text
    maglev("blind", "learn", tmp_path / "t", *arguments, "--out", tmp_path / "elsewhere.json")
    one, elsewhere = ((tmp_path / f"{name}.json").read_bytes() for name in ("one", "elsewhere"))
    assert one == elsewhere
    judge = judge_from(json.loads(one))
    assert judge.made_by["command"] == "maglev blind learn --count 40 --seed 3" and judge.made_by["examples"] == 40
    assert judge.made_by["learned_by"] == code_version(DIAGNOSING, blind=True) != judge.made_by["version"]
    assert set(judge.trust) == {"displacement"} and len(judge.left["displacement"]) > 10
    assert "holds 40 campaigns of the benchmark, seed 3" in maglev(
        "blind", "learn", tmp_path / "s", "--seed", 4, "--count", 40, "--out", tmp_path / "x.json", code=2
    )
