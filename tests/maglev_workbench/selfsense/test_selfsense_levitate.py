"""`maglev selfsense levitate` on a short protocol: against other models, borders by hand, and a rotor it loses."""

import json
from dataclasses import replace
from functools import partial
from importlib import resources

import numpy as np
import pytest
from command_line import maglev

from maglev_env.experiment import protocol_experiment
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.gains import with_gains
from maglev_env.recordings.formats.json_data import plain
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.self_sensor import rig_sensors
from maglev_workbench.commands.selfsense.levitate import experiments
from maglev_workbench.commands.selfsense.levitate.experiments import SEEDS, compare, map_plan
from maglev_workbench.commands.selfsense.levitate.figures import cost_map, sensitivity
from maglev_workbench.commands.selfsense.levitate.numbers import levitate_json
from maglev_workbench.commands.selfsense.levitate.report import levitate_page, levitate_summary
from maglev_workbench.commands.selfsense.loop_facts import mean_with_half_width
from selfsense.linear import tracking

run = partial(maglev, "selfsense")
POINTS = 4
PROTOCOL = f"""
[protocol]
periods = 3
transient_periods = 1
band_width = 60.0
band_overlap = 30.0
[[protocol.excitation]]
kind = "sphs"
at = "force"
fundamental = 5.0
amplitude = 0.4
lines = {list(range(1, 50, 2))}
[[protocol.excitation]]
kind = "sphs"
at = "current"
fundamental = 5.0
amplitude = 0.1
lines = {[*range(2, 51, 2), *range(60, 400, 30)]}
"""


def short_rig(folder, current_noise="2e-3"):
    """hmb_free with a protocol of 0.8 s."""
    text = (resources.files("maglev_env") / "rigs" / "hmb_free.toml").read_text().split("[protocol]")[0]
    path = folder / "short.toml"
    path.write_text(text.replace("current = 2e-3", f"current = {current_noise}") + PROTOCOL)
    return path


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    rig = load_rig(short_rig(tmp_path_factory.mktemp("rig")))
    return compare(map_plan(rig, POINTS, 3))


@pytest.mark.slow
def test_what_it_costs_is_the_lag_of_the_estimator_alone(found):
    """The sampled estimator's own phase at the crossover, and how far the probe's is behind already."""
    data = levitate_json(found)
    rig, sensor = found.rig, rig_sensors(found.rig)[0]
    crossing = np.mean(found.preset["self_sensing"].margins["phase_margin_frequency"])
    probe = np.degrees(np.arctan(2 * np.pi * crossing * rig.sensor_time_constant))
    expected = -np.degrees(np.angle(tracking(sensor, crossing))) - probe
    added, lost = data["errors"]["added_phase"], data["errors"]["margin_lost"]
    assert added["mean"] == pytest.approx(expected, abs=1.5 * added["half_width"])
    assert added["half_width"] < 0.4 < expected / 2
    assert lost["mean"] == pytest.approx(expected, abs=1.5 * lost["half_width"])
    modelled = data["probe"]["linear_model"]["phase_margin"] - data["self_sensing"]["linear_model"]["phase_margin"]
    assert modelled == pytest.approx(expected, rel=0.2)


@pytest.mark.slow
def test_both_loops_are_those_of_the_linear_model(found):
    for sensor, curve in found.curves.items():
        at_lines = np.interp(curve.frequency, curve.model_frequency, np.abs(curve.model))
        off = (np.abs(curve.measured) - at_lines) / np.sqrt(curve.variance / 2 + (0.005 * at_lines) ** 2)
        assert np.sqrt(np.mean(off**2)) < 2, sensor
        measured = np.mean(found.preset[sensor].margins["phase_margin"])
        assert measured == pytest.approx(curve.model_margins["phase_margin"], abs=0.3)
    drawn = [trace.name for trace in sensitivity(found.curves).data]
    assert drawn == ["probe, linear model", "probe", "self-sensing, linear model", "self-sensing"]


@pytest.mark.slow
def test_json_holds_the_comparison_and_its_differences(found):
    data = levitate_json(found)
    assert data["schema"] == "maglev-selfsense-levitate/1" and data["seed"] == 3 and data["experiments"] == SEEDS
    assert data["probe"]["levitates"] and data["self_sensing"]["levitates"]
    assert data["levitates_without_noise"] is None
    probe, sensed = found.preset["probe"], found.preset["self_sensing"]
    assert data["probe"]["stiffness"] == probe.stiffness[0]
    assert data["self_sensing"]["damping_ci"] == [sensed.damping_low[0], sensed.damping_high[0]]
    assert data["difference"]["damping"]["mean"] == pytest.approx(np.mean(sensed.damping - probe.damping))
    # Lag in the loop takes damping; the noise of the current costs current.
    assert data["difference"]["damping"]["mean"] < -3 * data["difference"]["damping"]["half_width"]
    assert data["difference"]["current_rms"]["mean"] > 3 * data["difference"]["current_rms"]["half_width"]
    assert 0.5e-6 < data["self_sensing"]["gap_error_rms"] < 2e-6
    assert data["probe"]["gap_error_rms"] is None
    assert json.loads(json.dumps(data, allow_nan=False)) == data


@pytest.mark.slow
def test_the_map_is_ordered_kp_then_kd(found):
    of_map = levitate_json(found)["map"]
    low, high = found.rig.bounds["kp"]
    assert of_map["kp"] == pytest.approx(np.geomspace(low, high, POINTS))
    radius = [
        [
            np.abs(closed_loop_poles(protocol_experiment(found.rig, with_gains(found.rig.gains, kp=kp, kd=kd)))).max()
            for kd in of_map["kd"]
        ]
        for kp in of_map["kp"]
    ]
    stable = np.array(radius) < 1
    assert not stable.all() and not np.array_equal(stable, stable.T)
    assert np.array_equal(of_map["probe"]["feasible"], stable)
    held = np.array(of_map["self_sensing"]["feasible"])
    assert of_map["held"] == {"probe": int(stable.sum()), "self_sensing": int(held.sum())}
    assert of_map["held_by_probe_only"] == int((stable & ~held).sum())
    lost = np.array(of_map["model_margin_lost"], dtype=float)
    assert np.array_equal(np.isfinite(lost), stable & held) and np.nanmin(lost) > 0
    # More kd moves the crossover up, where the same delay is more phase.
    assert np.all(lost[:, -1] > lost[:, -2])


@pytest.mark.slow
def test_borders_lie_between_what_a_sensor_holds_and_what_it_does_not(found):
    held = {"probe": np.ones((POINTS, POINTS), bool), "self_sensing": np.ones((POINTS, POINTS), bool)}
    held["probe"][3, 0] = False
    held["self_sensing"][2:, :2] = False
    fake = {s: replace(e, feasible=held[s].ravel()) for s, e in found.map.items()}
    figure = cost_map(replace(found, map=fake))
    borders = {t.name: t for t in figure.data if (t.name or "").startswith("stability border")}
    x, y = borders["stability border, probe"].x, borders["stability border, probe"].y
    kp, kd = found.gains["kp"] / 1e3, found.gains["kd"]
    assert np.nanmin(x) == pytest.approx(np.sqrt(kp[2] * kp[3])) and np.nanmax(x) > kp[3]
    assert np.nanmax(y) == pytest.approx(np.sqrt(kd[0] * kd[1])) and np.nanmin(y) < kd[0]
    segments = np.isnan(np.array(borders["stability border, self-sensing"].x, dtype=float)).sum()
    assert segments == 4  # two cells wide, two high
    cells = [t.z for t in figure.data if t.type == "heatmap"]
    assert np.sum(np.asarray(cells[0], dtype=float) == 1) == 3  # only the probe holds them; (kd, kp)
    assert cells[0][1][2] == 1 and np.isnan(cells[1][1][2]) and cells[0][0][3] == 0


@pytest.mark.slow
def test_the_command_writes_page_json_and_table(found, tmp_path, monkeypatch):
    monkeypatch.setattr(experiments, "compare", lambda plan, threads, progress: found)
    page, js = tmp_path / "p.html", tmp_path / "l.json"
    text = run("levitate", "--rig", short_rig(tmp_path), "--points", POINTS, "--out", page, "--json", js)
    assert "hmb_free levitates with self-sensing" in text and "phase margin lost" in text
    assert json.loads(js.read_text()) == plain(levitate_json(found))
    html = page.read_text()
    assert (
        html.count("plotly-graph-div") == 4 and "What self-sensing adds" in html and "axis" not in html.split("<h2>")[1]
    )


@pytest.mark.slow
def test_a_rotor_that_only_the_probe_holds_is_said_to_be_lost(tmp_path):
    rig = load_rig(short_rig(tmp_path, current_noise="0.4"))
    lost = compare(map_plan(rig, 2, 0))
    data, text = levitate_json(lost), levitate_summary(lost)
    assert "does not levitate" in text and "touches down after" in text and "noise of 400 mA" in text
    assert data["levitates_without_noise"] is True and data["probe"]["levitates"]
    assert not data["self_sensing"]["levitates"] and data["self_sensing"]["stiffness"] is None
    assert data["self_sensing"]["touchdown_time"] > 0
    assert lost.piece.why == "until the rotor touched down" and np.isfinite(lost.piece.position).all()
    html = levitate_page(lost)
    assert "What self-sensing adds" not in html and "end of the estimator" in html


def test_half_widths_cover_the_mean_in_95_of_100_cases():
    samples = np.random.default_rng(1).normal(3.0, 2.0, (4000, 8))
    means, halves = np.array([mean_with_half_width(row) for row in samples]).T
    assert np.mean(np.abs(means - 3.0) < halves) == pytest.approx(0.95, abs=0.012)
    assert mean_with_half_width(np.array([np.nan, 2.0]))[0] == 2.0
    assert np.isnan(mean_with_half_width(np.array([np.nan, 2.0]))[1])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--points", 1], "--points"),
        (["--rig", "linear.toml"], "numerator and denominator"),
        (["--rig", "unbounded.toml"], "[bounds] lacks kd"),
    ],
)
def test_bad_input_ends_before_any_work(arguments, words, tmp_path, monkeypatch):
    def work(*_):
        raise AssertionError("work began")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(experiments, "compare", work)
    text = short_rig(tmp_path).read_text()
    gains = text[text.index("kp = 8000.0") : text.index("[noise]")]
    (tmp_path / "linear.toml").write_text(
        text.replace(gains, "numerator = [8000.0, -7000.0]\ndenominator = [1.0, -0.2]\n")
    )
    (tmp_path / "unbounded.toml").write_text(text.replace("kd = [1.0, 20.0]", ""))
    assert words in run("levitate", *arguments, code=2)
    assert not list(tmp_path.glob("*.html"))
