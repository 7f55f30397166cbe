"""The blind commands as a user runs them, on a sealed set made by hand and on a small one of the generator."""

import json
from hashlib import sha256

import pytest
from command_line import maglev

import sim2real
from maglev_workbench.commands.blind import sealed_set
from sim2real.advice import gain_choice
from sim2real.blind import generate as generator

KINDS = ("none", "single", "single", "pair", "unknown", "none")
EFFECTS = ((), ("delay",), ("mass",), ("delay", "damping"), ("quadratic_probe",), ())


class Said:
    """A diagnosis that finds a delay in every second campaign and nothing in the others."""

    def __init__(self, campaign):
        if campaign.name == "c0005":
            raise RuntimeError("broke | here")
        self.found = int(campaign.name[1:]) % 2 == 1
        self.evidence = None

    def to_json(self):
        name = "delay" if self.found else "none"
        return {
            "schema": "maglev-diagnosis/1",
            "verdict": "explained" if self.found else "no_gap",
            "cause": ["delay"] if self.found else [],
            "where": {"blocks": {"controller": 1.0}},
            "which": [{"effects": [name], "probability": 1.0, "parameters": {}}],
            "gap": {"closed_fraction": 0.9},
        }


def made_by_hand(folder, count, seed, processes=1, labels=None, advance=None):
    """What the generator would write, without a single sample: six campaigns below 10 times the threshold."""
    rows = []
    for i, (kind, effects) in enumerate(zip(KINDS, EFFECTS, strict=True)):
        campaign = folder / f"c{i:04d}"
        campaign.mkdir(parents=True)
        (campaign / "campaign.toml").write_text("[[recording]]\nspeed_rpm = 0.0\n")
        sizes, names = [5.0] * len(effects), {name: {} for name in effects}
        row = {"id": campaign.name, "kind": kind, "effects": names, "sizes": sizes, "rig": "hmb_free"}
        rows.append(row | {"channels": ("full", "displacement")[i % 2]})
    labels.write_text(json.dumps(rows))
    return sha256(labels.read_bytes()).hexdigest()


@pytest.fixture
def by_hand(monkeypatch):
    monkeypatch.setattr(sim2real, "diagnose", Said, raising=False)
    monkeypatch.setattr(generator, "generate", made_by_hand)


def test_a_set_is_generated_answered_and_opened(tmp_path, by_hand):
    out, docs, js = tmp_path / "set", tmp_path / "blind.md", tmp_path / "b.json"
    text = maglev("blind", "generate", "--count", 6, "--seed", 3, "--out", out)
    digest = sha256((out / "labels.json").read_bytes()).hexdigest()
    assert digest in text and (out / "labels.sha256").read_text().split() == [digest, "labels.json"]
    assert "not empty" in maglev("blind", "generate", "--count", 6, "--seed", 3, "--out", out, code=2)
    assert "missing" in maglev("blind", "open", out, code=2)
    assert "6 answered, 0 reused, 1 of both failed" in maglev("blind", "answer", out, "--processes", 1)
    assert "0 answered, 6 reused" in maglev("blind", "answer", out, "--processes", 1, "--json", js)
    data = json.loads(js.read_text())
    assert (data["reused"], data["method"], data["set"], data["labels_sha256"]) == (6, "diagnose", str(out), digest)
    assert "false alarm" in maglev("blind", "open", out, "--docs", docs, "--json", js)
    data = json.loads(js.read_text())
    assert data == json.loads((out / "blind.json").read_text()) and data["schema"] == "maglev-blind/1"
    targets = {row["name"]: row for row in data["targets"]}
    assert (targets["false alarm"]["value"], targets["false alarm"]["n"]) == (0.5, 2)  # the failed one is an alarm
    middle = targets["right class or correct abstention, 1-10 x"]
    assert (middle["value"], middle["n"]) == (0.5, 2) and middle["floor"] == 0.55 and middle["verdict"] == "missed"
    assert targets["pairs: at least one named"]["value"] == 1.0 and targets["pairs: both named"]["value"] == 0.0
    assert data["failed"] == 1 and data["cases"][5]["error"] == "RuntimeError: broke | here"
    assert data["by"]["channels"].keys() == {"full", "displacement"} and data["set"]["seed"] == 3
    page, markdown = (out / "blind.html").read_text(), docs.read_text()
    for shown in (digest, data["version"], data["answers_sha256"], "[quadratic_probe]", "Effects that look alike"):
        assert shown in page and shown in markdown
    assert "(blind.png)" in markdown and (tmp_path / "blind.png").read_bytes().startswith(b"\x89PNG")
    assert all(line.count("|") >= 3 for line in markdown.splitlines() if line.startswith("|"))
    (out / "answers" / "c0001.json").unlink()
    assert "opened already" in maglev("blind", "answer", out, "--processes", 1, code=2)


def test_changed_labels_are_not_scored(tmp_path, by_hand):
    maglev("blind", "generate", "--count", 6, "--seed", 3, "--out", tmp_path / "s")
    maglev("blind", "answer", tmp_path / "s", "--processes", 1)
    labels = tmp_path / "s" / "labels.json"
    labels.write_text(labels.read_text().replace("mass", "delay"))
    assert "it was changed" in maglev("blind", "open", tmp_path / "s", code=2)
    assert not (tmp_path / "s" / "blind.json").exists()


def test_run_does_it_all_and_goes_on_where_it_stopped(tmp_path, by_hand):
    out = tmp_path / "set"
    maglev("blind", "generate", "--count", 24, "--seed", 3, "--out", out)
    assert "seed 3" in maglev("blind", "run", "--seed", 4, "--quick", "--out", out, code=2)
    text = maglev("blind", "run", "--seed", 3, "--quick", "--processes", 1, "--out", out)
    assert "6 answered" in text and (out / "blind.html").exists()
    again = maglev("blind", "run", "--seed", 3, "--quick", "--processes", 1, "--out", out)
    assert "0 answered, 6 reused" in again  # and the same figures once more
    assert "does not exist" in maglev("blind", "open", out, "--docs", tmp_path / "no" / "b.md", code=2)
    assert "no whole sealed set" in maglev("blind", "answer", tmp_path, code=2)


def test_answers_that_replace_those_of_another_version_are_counted(tmp_path, by_hand):
    out, js = tmp_path / "set", tmp_path / "b.json"
    maglev("blind", "generate", "--count", 6, "--seed", 3, "--out", out)
    maglev("blind", "answer", out, "--processes", 1)
    for version in ("older", "old"):
        for name in ("c0001", "c0005"):
            path = out / "answers" / f"{name}.json"
            path.write_text(json.dumps(json.loads(path.read_text()) | {"version": version}))
        text = maglev("blind", "answer", out, "--processes", 1, "--json", js)
        assert "2 answered (2 of them again: those there were of another version of the code), 4 reused" in text
        assert json.loads(js.read_text())["again"] == 2
    assert json.loads((out / "answers" / "c0005.json").read_text())["replaces"] == ["older", "old"]
    assert "replaces" not in json.loads((out / "answers" / "c0000.json").read_text())
    maglev("blind", "open", out, "--json", js)
    assert json.loads(js.read_text())["answered_again"] == 2
    page = (out / "blind.html").read_text()
    assert "Answers that replace one by another version" in page and "Nothing was changed" not in page


def test_run_refuses_at_once_what_it_cannot_open(tmp_path, by_hand, monkeypatch):
    monkeypatch.setattr(sealed_set, "answer", lambda *_: pytest.fail("nothing may be answered"))
    out = tmp_path / "set"
    out.mkdir()
    (out / "set.json").write_text(json.dumps({"count": 6, "seed": 3, "benchmark": True}))
    text = maglev("blind", "run", "--seed", 3, "--count", 6, "--out", out, code=2)
    assert "is a set of the benchmark" in text
    text = maglev("blind", "run", "--seed", 3, "--count", 6, "--quick", "--out", out, code=2)
    assert "--quick or --count, not both" in text


@pytest.mark.slow
def test_the_generators_labels_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(sim2real, "diagnose", Said, raising=False)
    plan = [generator.Case(1, "stand", "full", "single", ("runout",))]
    monkeypatch.setattr(generator, "plan", lambda count, seed: plan)
    monkeypatch.setattr(generator, "SIZES", (20.0, 21.0))
    monkeypatch.setattr(generator, "PERIODS", 3)
    monkeypatch.setattr(gain_choice, "FACTORS", ((1.0, 1.0), (1.0, 1.4)))
    maglev("blind", "generate", "--count", 1, "--seed", 5, "--processes", 1, "--out", tmp_path / "s")
    maglev("blind", "answer", tmp_path / "s", "--processes", 1)
    maglev("blind", "open", tmp_path / "s", "--json", tmp_path / "b.json")
    data = json.loads((tmp_path / "b.json").read_text())
    found = data["cases"][0]
    assert (found["kind"], found["effects"], found["right_class"]) == ("single", ["runout"], False)
    assert 19.9 < found["size"] < 21.1 and data["regret"][0]["best"] > 0


def test_a_set_that_was_begun_goes_on_and_is_not_mixed_with_another(tmp_path, by_hand, monkeypatch):
    whole = generator.generate

    def interrupted(**values):
        values["folder"].mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr(generator, "generate", interrupted)
    out = tmp_path / "set"
    said = maglev("blind", "generate", "--count", 6, "--seed", 3, "--out", out, code=130)
    assert "run the same command again to continue" in said
    said = maglev("blind", "generate", "--count", 6, "--seed", 4, "--out", out, code=2)
    assert "another set" in said
    monkeypatch.setattr(generator, "generate", lambda **values: (values["folder"].rmdir(), whole(**values))[1])
    maglev("blind", "generate", "--count", 6, "--seed", 3, "--out", out)
    assert (out / "set.json").is_file() and not (out / "begun.json").exists()
