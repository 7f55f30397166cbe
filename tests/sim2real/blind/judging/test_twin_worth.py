"""What diagnosis is worth: simulators that know the truth tune as the twin itself, others worse; and what is kept."""

import json
from dataclasses import replace

import numpy as np
import pytest
from sealed_sets import diagnosis, label, seal
from typer.testing import CliRunner

from maglev_env.rig.rig_file import load_rig, rig_from_toml
from maglev_env.task.protocol import env_protocol
from maglev_workbench.cli import app
from maglev_workbench.commands.compare import twin as command_twin
from maglev_workbench.commands.compare.twin_report import Compared, summary, twin_markdown
from sim2real.blind.cases import parse_diagnosis
from sim2real.blind.judging import worth
from sim2real.blind.judging.worth import CORRECTED, NOMINAL, PRESET, SIMULATORS, TWIN, TwinCase, written_point
from sim2real.blind.rigs import RIGS
from sim2real.blind.twin import Truth
from sim2real.compared.point import Point
from tuning.comparison import twin as search
from tuning.comparison.twin import case_worth, compare_simulators, tuned

RUN = CliRunner()
WEAK = {"actuator_gain": {"change": -0.3}}
BUDGETS = dict.fromkeys(SIMULATORS, 40)


def a_case(effects=WEAK, corrected=WEAK, name="hmb_free", number=1):
    """A rig of the twin under the protocol that takes an eighth of the time."""
    rig = load_rig("hmb_free") if name == "hmb_free" else rig_from_toml(RIGS["stand"].toml, "stand")
    rig = replace(rig, protocol=env_protocol(rig, "quick"))
    words = (" + ".join(effects), " + ".join(corrected), effects == corrected)
    return TwinCase(f"c{number:04d}", "full", 20.0, *words, rig, Truth(name, effects=effects), Point(corrected, {}))


def kept(score, peak=2.0, failures=0, tried=10, failed=0):
    gains = {"kp": 8000.0, "ki": 2000.0, "kd": 5.2}
    return worth.Recommended(gains, 0.9, score, peak, 1e-5, failures, tried, failed)


def a_result(number, preset, nominal, corrected, twin, right=True):
    by = {PRESET: kept(preset, tried=0), NOMINAL: nominal, CORRECTED: corrected, TWIN: twin}
    by = {name: one if isinstance(one, worth.Recommended) else kept(one) for name, one in by.items()}
    return worth.CaseWorth(f"c{number:04d}", "hmb_free", "full", 20.0, "delay", "mass", right, by)


RESULTS = [
    a_result(1, 0.4, 0.5, 0.85, kept(0.9, failed=3)),
    a_result(2, 0.2, kept(0.0, np.nan, worth.AGAIN), kept(0.6, 3.0), kept(0.5, 4.0, failures=1)),
    a_result(3, 0.7, 0.5, 0.6, 0.65, right=False),
]


def test_regrets_are_below_the_best_that_anything_reached_and_their_sums_are_compared():
    assert [c.best for c in RESULTS] == [0.9, 0.6, 0.7]
    of = worth.totals(RESULTS)
    assert [of[name].regret for name in (PRESET, *SIMULATORS)] == pytest.approx([0.9, 1.2, 0.15, 0.15])
    assert [of[name].failures for name in (PRESET, *SIMULATORS)] == [0, 1, 0, 1]
    assert [of[name].peak_sensitivity for name in SIMULATORS] == [2.0, 2.0, 2.0]
    assert worth.totals(RESULTS[1:2])[TWIN].peak_sensitivity == np.inf  # one failure of many is one too many
    assert (of[TWIN].tried, of[TWIN].failed) == (30, 3)
    value, low, high = worth.reduction(RESULTS)
    assert value == pytest.approx(1 - 0.15 / 1.2)
    # Resampled, it lies between the worst and the best single case.
    assert low == pytest.approx(0.5) and high == pytest.approx(1.0)
    assert worth.reduction(RESULTS, TWIN)[0] == pytest.approx(1 - 0.15 / 1.2)
    assert worth.reduction([a_result(1, 0.9, 0.8, 0.7, 0.9)])[0] == pytest.approx(-1.0)  # twice the regret


@pytest.mark.slow
def test_page_words_and_json_say_the_same(tmp_path, monkeypatch):
    folder = seal(tmp_path / "set", [label(1)])
    monkeypatch.setattr(command_twin, "twin_cases", lambda folder, most: [a_case()])
    monkeypatch.setattr(command_twin, "answers_digest", lambda *_: "y")
    monkeypatch.setattr(command_twin, "compare_simulators", lambda *a: (RESULTS, 2))
    docs, file = tmp_path / "worth.md", tmp_path / "worth.json"
    (folder / "worth").mkdir()
    result = RUN.invoke(app, ["compare", "--twin", folder, "--budgets", "90,30", "--docs", docs, "--json", file])
    text = " ".join(result.output.split())
    data, page, markdown = json.loads(file.read_text()), (folder / "worth" / "twin.html").read_text(), docs.read_text()
    assert result.exit_code == 0 and json.loads((folder / "worth" / "twin.json").read_text()) == data
    assert data["schema"] == "maglev-twin/1" and data["reached"] and not data["equal_budgets"]
    assert data["reduction"]["corrected"][0] == pytest.approx(0.875)
    assert data["cases"][1]["by"]["nominal"]["peak_sensitivity"] is None
    for shown in (text, page, markdown):
        assert "88 % [50 %, 100 %]" in shown and "unequal budgets: 90 experiments on either simulator, 30" in shown
        assert "reached, which the interval does not settle" in shown
    assert "2 of 1 cases reused" in text and "1.20 by the nominal simulator" in text
    assert "Before and after the diagnosis" in page and "--budgets 90,30" in markdown
    assert f"| wrong or none | 1 | {0:.2f} | 0.20 | 0.10 | 0.05 | 50 % [50 %, 50 %] |" in markdown
    equal = Compared(RESULTS, BUDGETS, 0, {}, "0" * 64)
    assert "equal budgets of 40 experiments" in summary(equal) and "Equal budgets" in twin_markdown(equal, "")


def test_a_sealed_set_is_refused_until_it_is_opened(tmp_path):
    folder = seal(tmp_path / "set", [label(1), label(2, sizes=(5.0,))])
    result = RUN.invoke(app, ["compare", "--twin", str(folder)])
    assert result.exit_code == 2 and "answer and open it first" in result.output
    assert not (folder / "worth").exists()
    (folder / "blind.json").write_text("{}")
    with pytest.raises(ValueError, match="is missing: every campaign must be answered"):
        worth.twin_cases(folder)
    small = seal(tmp_path / "small", [label(1, sizes=(5.0,))])
    (small / "blind.json").write_text("{}")
    with pytest.raises(ValueError, match="no single effect of 10 times its threshold"):
        worth.twin_cases(small)
    with pytest.raises(ValueError, match=r"holds no labels\.sha256"):
        worth.twin_cases(tmp_path)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("tpe", "--twin", "set"), "METHOD makes no sense with --twin"),
        (("--twin", "set", "--rigs", "3"), "--rigs makes no sense with --twin"),
        (("--cases", "3"), "--cases goes with --twin only"),
        (("--twin", "set", "--budgets", "3,2,1"), "--budgets '3,2,1': with --twin"),
        (("--twin", "set", "--budgets", "0"), "--budgets '0'"),
    ],
)
def test_options_that_do_not_go_together_are_refused(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "set").mkdir()
    result = RUN.invoke(app, ["compare", *arguments])
    assert result.exit_code == 2 and words in " ".join(result.output.split())


def test_the_correction_is_the_one_written_and_the_nominal_rig_where_it_is_refused():
    rig = load_rig("hmb_free")
    written = diagnosis("explained", ["delay"]) | {"corrected": {"effects": WEAK, "changes": {"mass": 0.01}}}
    assert written_point(written, parse_diagnosis(written, 1.0, "v"), rig) == Point(WEAK, {"mass": 0.01})
    for refused in ({"effects": {"delay": {"time": 5.0}}}, {"effects": {}, "changes": {"mass": -2.0}}):
        wrong = diagnosis("no_gap") | {"corrected": {"changes": {}} | refused}
        assert written_point(wrong, parse_diagnosis(wrong, 1.0, "v"), rig) == Point({}, {})
    older = diagnosis("explained", ["delay"])
    older["which"][0]["parameters"] = {"delay.time": {"value": 5e-5}}
    assert written_point(older, parse_diagnosis(older, 1.0, "v"), rig) == Point({"delay": {"time": 5e-5}}, {})


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hmb_free", "stand"])
def test_the_corrected_simulator_scores_as_the_twin_does(name):
    case = a_case(name=name)
    points = case.start + np.array([[0, 0, 0], [0.3, 0, 0.2], [-0.3, 0.4, 0]])
    of = {s: case.scores(s, points, [1, 2, 3])[0] for s in SIMULATORS}
    assert of[CORRECTED] == pytest.approx(of[TWIN], abs=0.04)
    assert abs(of[NOMINAL] - of[TWIN]).max() > 0.2
    preset = case.box.gains(case.start)
    assert preset == pytest.approx([getattr(case.rig.gains, n) for n in case.box.names])


@pytest.mark.slow
def test_a_right_diagnosis_tunes_as_the_twin_does_and_a_wrong_one_worse(monkeypatch):
    monkeypatch.setattr(search, "METHOD", "tpe")  # quick to ask
    case = a_case()
    found = case_worth(case, BUDGETS, 0)
    assert found.regret(CORRECTED) < 0.05 and found.regret(TWIN) < 0.05 < 0.15 < found.regret(NOMINAL)
    assert {r.tried for n, r in found.by.items() if n != PRESET} == {40}
    wrong = a_case(corrected={"actuator_gain": {"change": 0.3}})
    point = tuned(wrong, CORRECTED, BUDGETS[CORRECTED], 0).point
    misled = worth.recommended(case, point, np.nan, 0, 0, [1, 2])
    assert misled.score < found.by[NOMINAL].score - 0.1  # worse than no diagnosis at all


def test_the_last_experiments_repeat_the_best_and_a_lucky_score_is_not_recommended(monkeypatch):
    class Lucky(TwinCase):
        """The preset scores 1 at first and 0 when it is repeated, all else 0.5."""

        def scores(self, simulator, points, seeds):
            asked.extend(seeds)
            preset = np.isclose(points, self.start).all(axis=1)
            return np.where(preset, float(len(points) == 1), 0.5), preset & (len(points) > 1)

    asked: list[int] = []
    monkeypatch.setattr(search, "METHOD", "tpe")  # quick
    plain = a_case()
    case = Lucky(**{name: getattr(plain, name) for name in TwinCase.__dataclass_fields__})
    found = tuned(case, NOMINAL, 40, 1)
    assert found.promised == 0.5 and not np.allclose(found.point, case.start)
    assert found.tried == 40 == len(set(asked)) and found.failed == search.REPEATS
    few = tuned(case, NOMINAL, 20, 1)  # too few to repeat any
    assert few.promised == 1.0 and few.point == pytest.approx(case.start) and few.failed == 0


def test_finished_cases_are_kept_and_an_interrupt_says_how_to_go_on(tmp_path, monkeypatch):
    cases, done = [a_case(number=n) for n in (1, 2, 3)], []

    def stub(case, budgets, seed):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(case.id)
        return replace(RESULTS[1], id=case.id)

    monkeypatch.setattr(search, "case_worth", stub)
    out = tmp_path / "worth"
    arguments = (out, BUDGETS, 0, {"labels_sha256": "x"}, 1)
    with pytest.raises(KeyboardInterrupt):
        compare_simulators(cases, *arguments)
    assert sorted(p.name for p in out.glob("c*.json")) == ["c0001.json", "c0002.json"]
    (out / "c0001.json").write_text("{")  # damaged: made again
    done.clear()
    counts = []
    found, reused = compare_simulators(cases, *arguments, counts.append)
    assert done == ["c0001", "c0003"] and reused == 1 and counts == [1, 1, 1]
    assert [c.id for c in found] == ["c0001", "c0002", "c0003"]
    stored = found[1].by  # nan and all read back
    assert np.isnan(stored[NOMINAL].peak_sensitivity) and stored[TWIN] == RESULTS[1].by[TWIN]
    with pytest.raises(ValueError, match="comparison of simulators of another seed"):
        compare_simulators(cases, out, BUDGETS, 1, {"labels_sha256": "x"}, 1)
    done[:] = ["c0001", "c0003"]
    folder = seal(tmp_path / "set", [label(1)])
    monkeypatch.setattr(command_twin, "twin_cases", lambda folder, most: cases)
    monkeypatch.setattr(command_twin, "answers_digest", lambda *_: "y")
    result = RUN.invoke(app, ["compare", "--twin", str(folder), "--processes", "1"])
    assert result.exit_code == 130 and "same command again" in " ".join(result.output.split())


@pytest.mark.slow
def test_processes_change_nothing(tmp_path):
    cases = [a_case(number=n) for n in (1, 2)]
    short = replace(cases[0].rig, protocol=replace(cases[0].rig.protocol, periods=2, transient_periods=0))
    cases = [replace(case, rig=short) for case in cases]
    few = dict.fromkeys(SIMULATORS, 1)
    alone, _ = compare_simulators(cases, tmp_path / "a", few, 0, {}, 1)
    both, _ = compare_simulators(cases, tmp_path / "b", few, 0, {}, 2)
    assert [c.by[TWIN] for c in alone] == [c.by[TWIN] for c in both]
    assert alone[0].by[TWIN].score != alone[1].by[TWIN].score  # other noise
