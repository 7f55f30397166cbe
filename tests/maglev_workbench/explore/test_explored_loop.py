"""What the page says of a loop, against python-control, against identified experiments, and against itself as text."""

import csv
import shlex
import tomllib
from dataclasses import asdict, replace

import control
import numpy as np
import pytest
from command_line import maglev

from maglev_env.design.defaults import with_defaults
from maglev_env.experiment import protocol_experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.controller_forms import Pid
from maglev_env.loop.effect import EFFECTS, effect, meaningful
from maglev_env.loop.free import places as free
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.simulate import recordings
from maglev_workbench.explore.copied import Source, copies
from maglev_workbench.explore.curves import loop_curves
from maglev_workbench.explore.identified import identified
from maglev_workbench.explore.inputs import effect_inputs, gain_inputs
from maglev_workbench.explore.panels import csv_text, identified_curves, model_curves
from maglev_workbench.explore.setting import setting_from
from maglev_workbench.explore.words import answer

RIG = with_defaults(load_rig("hmb_free"))
RIGS = {name: with_defaults(load_rig(name)) for name in ("hmb_free", "eframe", "hmb_radial")}


def test_margins_are_those_of_python_control():
    found = loop_curves(protocol_experiment(RIG, effects=effect("delay", 7.5e-5)), 0)
    frd = control.frd(found.loop_gain, 2 * np.pi * found.frequency)
    cross = control.stability_margins(frd)[4]
    gain, phase, *_ = control.stability_margins(frd, returnall=True)
    assert found.margins["gain_margin_high"] == pytest.approx(min(g for g in gain if g > 1), rel=2e-3)
    assert found.margins["gain_margin_low"] == pytest.approx(max(g for g in gain if g < 1), rel=2e-3)
    assert found.margins["phase_margin"] == pytest.approx(np.abs(phase).min(), rel=2e-3)
    assert found.margins["phase_margin_frequency"] == pytest.approx(cross / 2 / np.pi, rel=2e-3)
    assert found.margins["peak_sensitivity"] == pytest.approx(np.abs(found.sensitivity).max(), rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hmb_free", "eframe"])
def test_the_identified_experiment_agrees_with_the_curves(name):
    """Nine of ten intervals hold the mean of the curve over their band, within a hundredth for the bent force law."""
    experiment = protocol_experiment(RIGS[name], effects=effect("delay", 2 / RIGS[name].control_rate), seed=3)
    model, found = loop_curves(experiment, 0), identified(experiment, 0)
    held = []
    for band in found.bands:
        inside = (model.lines >= band.f_lo) & (model.lines <= band.f_hi)
        if band.informative and band.f_lo > 30:
            for (low, high), curve in ((band.stiffness_ci, model.stiffness), (band.damping_ci, model.damping)):
                mean, room = curve[inside].mean(), 0.01 * np.abs(curve[inside]).max()
                held.append(low - room < mean < high + room)
    assert len(held) >= 20 and np.mean(held) >= 0.9
    assert found.stability.margins.peak_sensitivity == pytest.approx(model.margins["peak_sensitivity"], rel=0.06)


def test_the_other_axis_of_a_rig_has_its_own_curves():
    rig = RIGS["hmb_radial"]
    softer = replace(rig, per_axis={"y": {"mass": 2 * rig.mass}})
    x, y = (loop_curves(protocol_experiment(softer), axis) for axis in (0, 1))
    assert x.in_target[0] == pytest.approx(loop_curves(protocol_experiment(rig), 0).in_target[0], rel=1e-3)
    assert y.margins["peak_frequency"] < 0.8 * x.margins["peak_frequency"]
    static = [1 / found.step[-1] for found in (x, y)]
    assert np.isfinite(static).all() and x.stiffness.shape == y.stiffness.shape == x.lines.shape


@pytest.mark.parametrize("name", RIGS)
def test_every_effect_has_sliders_that_start_and_end_at_values_the_rig_accepts(name):
    rig = RIGS[name]
    found = effect_inputs(rig)
    assert {e.name for e in found} == {n for n in EFFECTS if meaningful(n, rig.capabilities)} - free.NAMES
    for one in found:
        start = {i.name: i.value for i in one.inputs}
        assert set(EFFECTS[one.name].plain) <= set(start)
        for i in one.inputs:
            assert i.low < i.high and i.low <= i.value <= i.high and (i.low > 0 or not i.log), (one.name, i)
            for end in (i.low, i.value, i.high):
                setting_from({"effects": {one.name: {**start, i.name: end}}}, rig, rig.gains)
    for axis in range(rig.axes):
        for i in gain_inputs(rig, rig.gains, axis):
            assert i.low < i.high and i.low <= i.value <= i.high and (i.low > 0 or not i.log)


def test_a_single_magnet_saturates_on_the_page_by_its_current():
    ball = Rig("ball", "electromagnet", mass=0.05, gap=8e-3, bias_current=0.9, control_rate=1000.0)
    (found,) = (one for one in effect_inputs(ball) if one.name == "saturation")
    sliders = {i.name: (i.low, i.value, i.high) for i in found.inputs}
    assert sliders.keys() == {"sharpness", "current", "creep", "distance_share"}
    assert sliders["current"] == pytest.approx((0.99, 1.8, 18.0))


def test_gains_of_other_controllers_have_sliders_too():
    names = [i.name for i in gain_inputs(RIG, Pid(8000.0, 100.0, 5.0), 0)]
    assert names == ["kp", "ki", "kd", "td", "setpoint_filter", "setpoint_weight"]
    assert all(i.low < i.high for i in gain_inputs(RIG, Pid(8000.0), 0))


def test_an_effect_of_the_rig_can_be_switched_off():
    rig = replace(RIG, effects=effect("delay", 1e-4))
    assert next(e for e in effect_inputs(rig) if e.name == "delay").on
    assert setting_from({}, rig, rig.gains).experiment.effects == {}
    with_it = setting_from({"effects": {"delay": {"time": 1e-4}}}, rig, rig.gains).experiment
    assert with_it.effects == rig.effects
    assert (
        "delay is off" in copies(setting_from({}, rig, rig.gains).experiment, rig, Source("r.toml", "x()"))["command"]
    )


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"gain": {}}, "unknown key 'gain'"), ({"gains": {"kp": "8"}}, "kp = '8' is not a number"),
        ({"gains": {"kq": 1.0}}, "kq"), ({"axis": 1}, "axis = 1"), ({"units": "feet"}, "units = 'feet'"),
        ({"seed": -1}, "seed = -1"), ({"gains": {"td": -1.0}}, "td = -1.0 s must be positive"),
        ({"effects": {"delay": {"time": 1.0}}}, "effect delay.time = 1.0 is outside"), ({"gains": 3}, "gains = 3"),
        ({"effects": {"gremlins": {}}}, "gremlins"), ([], "must be a table"),
    ],
)  # fmt: skip
def test_a_setting_that_is_wrong_is_named(data, words):
    with pytest.raises(ValueError) as caught:
        setting_from(data, RIG, RIG.gains)
    assert words in str(caught.value)


def test_an_unstable_loop_shows_nothing_that_needs_a_stable_one():
    setting = setting_from({"gains": {"kp": 500.0}}, RIG, RIG.gains)
    found = loop_curves(setting.experiment, 0)
    said = " ".join(s.text for s in answer(found, setting))
    assert "Unstable" in said and "margin" not in said and "N/m" not in said
    assert set(model_curves(found)) == {"gain", "phase", "nyquist"}
    with pytest.raises(ValueError, match="no steady response"):
        identified(setting.experiment, 0)


def test_units_change_sentences_and_table_alike():
    data = {"effects": {"delay": {"time": 1e-4}}}
    bench, files = (setting_from({**data, "units": units}, RIG, RIG.gains) for units in ("bench", "files"))
    found = loop_curves(bench.experiment, 0)
    k = found.in_target[0]
    assert f"Stiffness {k / 1e3:.1f} N/mm" in " ".join(s.text for s in answer(found, bench))
    assert f"Stiffness {k:.0f} N/m" in " ".join(s.text for s in answer(found, files))
    rows = {}
    for units in ("bench", "files"):
        lines = csv_text({"model": model_curves(found)}, units).splitlines()
        rows[units] = next(line.split(",") for line in lines if line.startswith("model,stiffness"))
    assert rows["bench"][5] == "N/mm" and rows["files"][5] == "N/m"
    assert float(rows["files"][4]) == pytest.approx(1e3 * float(rows["bench"][4]))


def test_a_layer_with_a_comma_in_its_name_stays_in_its_column():
    layers = {"run1.npz, x": {"gain": {"x": np.array([1.0]), "y": np.array([2.0])}}}
    _, row = csv.reader(csv_text(layers, "files").splitlines())
    assert row == ["run1.npz, x", "gain", "1", "Hz", "2", "", "", ""]


def test_what_is_copied_repeats_the_experiment(tmp_path, monkeypatch, capsys):
    data = {
        "gains": {"kp": 9000.0, "td": 2e-4},
        "effects": {"delay": {"time": 1e-4}, "amplifier_lag": {"time_constant": 5e-5, "feedback": 0.0}},
    }
    experiment = setting_from(data, RIG, RIG.gains).experiment
    found = copies(experiment, RIG, Source("hmb_free", "load_rig('hmb_free')"))
    table = tomllib.loads(found["toml"])
    assert table["gains"] == asdict(experiment.gains)
    assert table["effects"] == {name: dict(values) for name, values in experiment.effects.items()}

    planned = []
    monkeypatch.setattr(recordings, "record", lambda plan, *_: planned.append(plan.experiment) or 1 / 0)
    words = shlex.split(found["command"])
    assert words[:2] == ["maglev", "simulate"] and words[-2:] == ["--out", "explored"]
    maglev(*words[1:-1], tmp_path / "explored", code=2)
    assert planned == [experiment]

    names: dict = {}
    exec(found["python"].partition("found =")[0], names)
    assert names["experiment"] == experiment
    plain = setting_from({}, RIG, RIG.gains).experiment
    exec(copies(plain, RIG, Source("hmb_free", "load_rig('hmb_free')"))["python"], {})
    said = [float(word) for word in capsys.readouterr().out.splitlines()[-1].split()]
    model = loop_curves(plain, 0)
    assert said[2] == pytest.approx(model.margins["peak_sensitivity"], rel=0.05)


def test_identified_curves_have_their_intervals():
    curves = identified_curves(identified(protocol_experiment(RIG), 0))
    for name in ("stiffness", "damping", "sensitivity"):
        assert (curves[name]["low"] < curves[name]["high"]).all()
    assert (curves["stiffness"]["from"] < curves["stiffness"]["to"]).all()


def test_a_narrow_resonance_is_drawn_round():
    """Between its points the loop gain turns and grows by little, and the peak of S is that of a dense grid."""
    sharp = {"support_resonance": {"frequency": 300.0, "damping_ratio": 0.005, "mass_ratio": 0.1}}
    experiment = protocol_experiment(RIG, effects=sharp)
    found = loop_curves(experiment, 0)
    dense = np.linspace(250.0, 400.0, 20_000)
    peak = np.abs(loop_response(experiment, dense).sensitivity).max()
    near = (found.frequency > 250) & (found.frequency < 400)
    assert np.abs(found.sensitivity[near]).max() == pytest.approx(peak, rel=0.02)
    assert np.abs(np.log(found.loop_gain[near][1:] / found.loop_gain[near][:-1])).max() < 0.5
