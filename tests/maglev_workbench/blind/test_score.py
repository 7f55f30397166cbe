"""`maglev blind score` on a set made by hand: what counts as told, rivals, the oracle, and what is refused."""

import json
from hashlib import sha256

import pytest
from command_line import maglev

import sim2real
from maglev_lanes.code_version import DIAGNOSING, code_version
from maglev_workbench.commands.blind.next import trying
from sim2real.blind.benchmark import generate as generator
from sim2real.blind.benchmark.foils import nothing
from sim2real.blind.benchmark.promise import Tried
from sim2real.blind.benchmark.scores import SCORES, judged_with_rivals, rows_of, score_set, tellable
from sim2real.blind.cases import Case, parse_diagnosis

# kind, effects, size, rivals, verdict, cause
CASES = (
    ("none", (), None, (), "no_gap", ()),
    ("none", (), None, (), "explained", ("delay",)),
    ("single", ("delay",), 20.0, (), "explained", ("delay",)),
    ("single", ("mass",), 20.0, (), "ambiguous", ("mass", "friction")),
    ("single", ("mass",), 20.0, (("friction",),), "ambiguous", ("mass", "friction")),
    ("single", ("mass",), 0.7, (), "no_gap", ()),
    ("pair", ("delay", "damping"), 5.0, (), "explained", ("delay", "damping")),
    ("unknown", ("cogging",), 5.0, (), "unexplained", ()),
    ("unknown", ("cogging",), 5.0, (("force_law",),), "explained", ("force_law",)),
)


def said(campaign):
    _, _, _, _, verdict, cause = CASES[int(campaign.name[1:])]
    found = (
        [*cause]
        if verdict == "ambiguous"
        else ["+".join(cause)]
        if cause
        else [{"no_gap": "none"}.get(verdict, "unknown")]
    )
    which = [{"effects": one.split("+"), "probability": 1 / len(found)} for one in found]
    where = {"blocks": {"actuator": 1.0}}
    data = {"schema": "maglev-diagnosis/1", "verdict": verdict, "cause": list(cause), "which": which, "where": where}
    return data | {"gap": {"closed_fraction": 0.9}}


class Said:
    def __init__(self, campaign):
        self.data, self.evidence = said(campaign), None

    def to_json(self):
        return self.data


def made_by_hand(folder, count, seed, processes, labels, oracle=True, advance=None):
    rows = []
    for i, (kind, effects, size, rivals, _, _) in enumerate(CASES):
        (folder / f"c{i:04d}").mkdir(parents=True)
        (folder / f"c{i:04d}" / "campaign.toml").write_text("[[recording]]\nspeed_rpm = 0.0\n")
        row = {"id": f"c{i:04d}", "kind": kind, "rig": "ball", "channels": "full", "effects": {e: {} for e in effects}}
        row |= {"sizes": [size] if effects else [], "blocks": ["actuator"] if kind == "unknown" else []}
        rows.append(row | {"oracle": {"rivals": [{"effects": list(r), "distance": 1.0} for r in rivals]}})
    labels.write_text(json.dumps(rows))
    return sha256(labels.read_bytes()).hexdigest()


@pytest.fixture
def answered(tmp_path, monkeypatch):
    monkeypatch.setattr(sim2real, "diagnose", Said, raising=False)
    monkeypatch.setattr(generator, "generate", made_by_hand)
    out = tmp_path / "set"
    maglev("blind", "generate", "--benchmark", "--count", 9, "--seed", 3, "--out", out)
    maglev("blind", "answer", out, "--processes", 1)
    maglev("blind", "answer", out, "--processes", 1, "--method", "nothing")
    return out


def test_what_the_benchmark_made_is_bound_to_its_code(answered):
    """A foil and the generator are part of it, the diagnosis is not."""
    diagnosing, benchmark = (code_version(DIAGNOSING, blind) for blind in (False, True))
    assert diagnosing != benchmark
    for folder, version in (("answers", diagnosing), ("answers-nothing", benchmark)):
        assert json.loads((answered / folder / "c0000.json").read_text())["version"] == version
    assert json.loads((answered / "set.json").read_text())["version"] == benchmark
    stale = answered / "answers-nothing" / "c0000.json"
    stale.write_text(json.dumps(json.loads(stale.read_text()) | {"version": diagnosing}))
    assert "1 answered" in maglev("blind", "answer", answered, "--processes", 1, "--method", "nothing")


def test_methods_stand_beside_the_oracle(answered, tmp_path):
    docs, js = tmp_path / "b.md", tmp_path / "b.json"
    text = maglev("blind", "score", answered, "--docs", docs, "--json", js)
    assert "oracle" in text and "answers-nothing" in text
    data = json.loads(js.read_text())
    assert data["schema"] == "maglev-benchmark/1" and data == json.loads((answered / "blind.json").read_text())
    ours, foil = ({r["name"]: (r["value"], r["n"]) for r in m["rows"]} for m in data["methods"])
    assert [m["name"] for m in data["methods"]] == ["answers", "answers-nothing"]
    assert ours["false alarm"] == (0.5, 2) and foil["false alarm"] == (0.0, 2)
    assert ours["told, of what can be told, >= 1 x"] == (0.75, 4)  # delay, the pair, an unknown; not mass or friction
    assert foil["told, of what can be told, >= 1 x"] == (0.0, 4)
    assert ours["honest where it cannot be told, >= 1 x"] == (0.5, 2)  # the class; not a false name of the unknown
    assert ours["right class, >= 10 x"][0] == pytest.approx(2 / 3)
    assert ours["pairs: both named"] == (1.0, 1) and ours["right block, >= 1 x"][1] == 5
    oracle = {r["name"]: r["value"] for r in data["oracle"]}
    assert oracle["told, of what can be told, >= 1 x"] == 1.0 and oracle["unknown flagged, >= 1 x"] == 0.5
    assert data["methods"][0]["missed"] == ["c0001", "c0003"]
    markdown = docs.read_text()
    assert "c0008" in markdown and "friction" in markdown and data["labels_sha256"] in markdown
    assert all(line.count("|") >= 3 for line in markdown.splitlines() if line.startswith("|"))
    (answered / "answers" / "c0001.json").unlink()
    assert "opened already" in maglev("blind", "answer", answered, "--processes", 1, code=2)
    assert "missing" in maglev("blind", "score", answered, code=2)


def test_one_run_makes_answers_and_scores_and_the_page_again(tmp_path, monkeypatch):
    monkeypatch.setattr(sim2real, "diagnose", Said, raising=False)
    monkeypatch.setattr(generator, "generate", made_by_hand)
    out, docs = tmp_path / "set", tmp_path / "blind.md"
    command = ("blind", "run", "--benchmark", "--count", 9, "--seed", 3, "--out", out, "--processes", 1, "--docs", docs)
    maglev(*command)
    first = docs.read_text()
    assert (
        first.startswith("# The blind check of diagnoses")
        and "| figure | oracle | answers | answers-nothing |" in first
    )
    assert "`maglev blind run --benchmark --count 9 --seed 3 " in first and "answers-refit" in first
    maglev(*command)
    assert docs.read_text() == first
    assert "is a set of the benchmark: give --benchmark" in maglev(
        "blind", "run", "--seed", 3, "--count", 9, "--out", out, code=2
    )


def test_methods_that_are_not_scored_again_stay(answered, tmp_path):
    js = tmp_path / "b.json"
    maglev("blind", "score", answered)
    maglev("blind", "score", answered, answered / "answers", "--json", js)
    kept = json.loads((answered / "blind.json").read_text())
    assert [m["name"] for m in kept["methods"]] == ["answers-nothing", "answers"]
    assert [m["name"] for m in json.loads(js.read_text())["methods"]] == ["answers"]
    (answered / "blind.json").write_text(json.dumps(kept | {"version": "other"}))
    text = maglev("blind", "score", answered, answered / "answers")
    assert "scored by another version of the code, not kept: answers-nothing" in text
    assert [m["name"] for m in json.loads((answered / "blind.json").read_text())["methods"]] == ["answers"]


def judged(truth, cause, rivals=(), kind="single", blocks=("mechanics",), closed=0.0):
    """An answer on a ball, judged; the cause by members, none of "unexplained", all of the gap in the sensor."""
    label = {"oracle": {"rivals": [{"effects": [one], "distance": 1.0} for one in rivals]}, "blocks": list(blocks)}
    case = Case("c1", kind, "ball", "full", frozenset(truth), 20.0, frozenset({0.0}), label)
    verdict = ("unexplained", "explained", "ambiguous")[min(len(cause), 2)]
    which = [{"effects": [one], "probability": 1 / max(len(cause), 1)} for one in cause or ["unknown"]]
    data = {"schema": "maglev-diagnosis/1", "verdict": verdict, "cause": list(cause), "which": which}
    data |= {"where": {"blocks": {"sensor": 1.0}}, "gap": {"closed_fraction": closed}}
    return judged_with_rivals(case, parse_diagnosis(data, 1.0, "v"))


@pytest.mark.parametrize("other", ["force_law", "negative_stiffness"])
def test_on_a_ball_a_rival_has_both_names_of_its_mechanism(other):
    assert judged(["mass"], ["mass", other], rivals=["negative_stiffness"]).right_class
    assert tellable(judged(["negative_stiffness"], ["force_law"], rivals=[other]).case)


def test_of_an_unknown_cause_a_named_effect_in_its_block_is_in_the_right_block():
    (good,) = (score.good for score in SCORES if score.name == "right block")
    assert good(judged(["tilted_target"], ["sensor_resonance"], kind="unknown", blocks=["sensor"]))
    assert not good(judged(["tilted_target"], ["mass"], kind="unknown", blocks=["sensor"]))
    assert good(judged(["tilted_target"], [], kind="unknown", blocks=["sensor"]))


def test_nothing_can_be_closed_of_an_unknown_cause():
    singles = [judged(["mass"], ["mass"], closed=0.99) for _ in range(3)]
    unknown = [judged(["cable_creep"], [], kind="unknown") for _ in range(4)]
    (row,) = (row for row in rows_of([*singles, *unknown]) if "closed" in row.name)
    assert (row.value, row.n) == (0.99, 3)


def test_anothers_folder_of_answers_is_scored_and_one_for_another_set_is_refused(answered, tmp_path):
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    for path in (answered / "answers").iterdir():
        data = json.loads(path.read_text()) | {"version": "their method 1.0"}
        (theirs / path.name).write_text(json.dumps(data))
    found = score_set(answered, [theirs])
    assert found.methods[0].version == "their method 1.0" and found.methods[0].failed == 0
    (theirs / "c0000.json").write_text(json.dumps(data | {"labels_sha256": "0"}))
    assert "does not answer this sealed set" in maglev("blind", "score", answered, theirs, code=2)


def test_sets_of_the_two_generators_are_not_confused(answered):
    assert "maglev blind score" in maglev("blind", "open", answered, code=2)
    made = json.loads((answered / "set.json").read_text())
    (answered / "set.json").write_text(json.dumps(made | {"benchmark": False}))
    assert "maglev blind open" in maglev("blind", "score", answered, code=2)


def test_the_foil_that_finds_nothing_needs_no_campaign(tmp_path):
    assert nothing(tmp_path)["verdict"] == "no_gap"


def test_what_answers_ask_for_is_tried_after_they_were_scored(answered, tmp_path, monkeypatch):
    """Of the known effects from the threshold on, two are answered by a class."""
    asked = []

    def both(case, diagnosis, seed, count, diagnose):
        asked.append((case.id, seed, count))
        decided = case.id == "c0003"
        return {
            "proposed": Tried(("louder",), ("explained" if decided else "ambiguous",), 1 if decided else None),
            "random": Tried(("other gains", "louder"), ("ambiguous", "explained"), 2),
        }

    monkeypatch.setattr(trying, "try_both", both)
    assert "score its answers first" in maglev("blind", "next", answered, code=2)
    maglev("blind", "score", answered)
    docs, js = tmp_path / "next.md", tmp_path / "next.json"
    text = maglev("blind", "next", answered, "--processes", 1, "--docs", docs, "--json", js)
    assert asked == [("c0003", 3, 9), ("c0004", 3, 9)]
    assert "as proposed │ 2 │ 50 % │ 50 % │ 1.50" in text and "at random │ 2 │ 0 % │ 100 % │ 2.00" in text
    assert [one["proposed"]["decided"] for one in json.loads(js.read_text())["tried"]] == [1, None]
    assert "louder: explained (decided)" in docs.read_text()
    maglev("blind", "next", answered, "--processes", 1)
    assert len(asked) == 2  # what was tried is kept
