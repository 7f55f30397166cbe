"""`maglev tune --reference`: what the command says of references, and of requirements that nothing meets."""

import json
from functools import partial

import numpy as np
import pytest
from command_line import maglev

from maglev_env.loop.linear_controller import LinearController
from maglev_env.rig.goal import parse_goal
from maglev_workbench.commands.tune.references import Beside, reference_in_words, reference_json
from tuning.reference.reference import Reference
from tuning.study.recommendation import Recommendation, Verdict

run = partial(maglev, "tune")
GOAL = parse_goal("peak_sensitivity <= 2, noise_current <= 0.01, best compliance near 2e-5")
LIMITS = {"peak_sensitivity": 1.1, "noise_current": 0.004}


def verdict(peak, noise, compliance=1e-5, reason=None):
    values = {"peak_sensitivity": peak, "noise_current": noise, "compliance": compliance}
    required = {f"required_{name}": value for name, value in values.items()}
    return Verdict(np.zeros(0), 0.5, 0.0, {}, reason, required)


def said(chosen, *references, limits=LIMITS):
    own = [Reference("lqg", LinearController((1.0, 0.0), (1.0, 0.0)), {}, v, 40) for v in references]
    return reference_in_words(GOAL, Recommendation(chosen, ()), Beside(own, limits))


def test_what_is_unmet_is_told_from_what_is_unmeetable():
    good, loud = verdict(1.8, 0.009), verdict(1.8, 0.012, 4e-6)
    assert "noise current, which can be met: LQG meets every requirement" in said(loud, good)
    assert "where the recommended gains have 4.00 µm/N" in said(loud, good)
    assert "LQG (order 1) misses noise current" in said(loud, loud)
    assert "that noise current cannot be met is not proved" in said(loud, loud)
    proved = said(loud, loud, limits={"peak_sensitivity": 1.1, "noise_current": 0.011})
    assert "No linear controller of this model meets noise current at most 10 mA rms: the best of any is 11" in proved
    assert "not proved" not in proved
    assert "unmet" not in said(good, good) and "Missed" not in said(good, good)
    assert "it would be refused: it rings" in said(None, verdict(1.8, 0.009, reason="it rings"))


def test_the_json_holds_the_controller_and_the_limits_of_all():
    own = Reference("lqg", LinearController((1.0, 0.5), (1.0, 0.0)), {"force": 0.1}, verdict(1.8, 0.009), 40)
    data = reference_json(GOAL, Beside([own], LIMITS))
    assert data["linear_limits"] == LIMITS and data["references"][0]["requirements"]["peak_sensitivity"]["met"]
    assert data["references"][0]["controller"] == {"numerator": [1.0, 0.5], "denominator": [1.0, 0.0]}
    fallen = Reference("lqg", own.controllers, {}, verdict(np.inf, 0.009), 40)
    json.dumps(reference_json(GOAL, Beside([fallen], {"gain_margin": np.inf})), allow_nan=False)


@pytest.mark.slow
def test_a_tuned_result_stands_beside_a_reference(tmp_path, monkeypatch):
    monkeypatch.setattr("tuning.reference.reference.ROUNDS", 2)
    monkeypatch.setattr("tuning.reference.reference.ROUND", 8)
    monkeypatch.setattr("tuning.search.corrected.tuner.ROUNDS", 2)
    out, file = tmp_path / "s", tmp_path / "s.json"
    asked = ("--protocol", "quick", "--budget", 2, "--out", out, "--json", file)
    text = run("--goal", "phase_margin >= 20, noise_current <= 1e-6", "--reference", "lqg", *asked)
    assert "Beside linear controllers of this model" in text and "best of any" in text
    flat = " ".join(text.split())
    assert "No linear controller of this model meets noise current at most 0.001 mA rms" in flat
    data = json.loads(file.read_text())
    assert [one["kind"] for one in data["references"]] == ["lqg"] and data["linear_limits"]["noise_current"] > 1e-6
    page = (out / "tune.html").read_text()
    assert "Beside linear controllers of this model" in page and "References are no recommended controllers" in page


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--reference", "mpc", "--goal", "engineer"), "use one of lqg, h-infinity"),
        (("--reference", "lqg"), "references go with a goal of requirements"),
        (("--reference", "lqg", "--rig", "pump"), "--reference"),
    ],
)
def test_bad_input_is_refused_before_any_work(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert words in run(*arguments, code=2)
    assert not list(tmp_path.iterdir())


def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tuning.reference.kinds.find_spec", lambda name: None)
    text = run("--reference", "h-infinity", "--goal", "engineer", code=2)
    assert "pip install 'maglev-workbench[reference]'" in text and not list(tmp_path.iterdir())
