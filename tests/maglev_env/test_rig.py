"""Rigs, gains, excitations and effects at their boundary, and the presets' numbers against the published ones."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_env.effects import EFFECTS, effect, parse_effect, parse_effects
from maglev_env.excitation import Excitation, check_interleaved, lines_at
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.gains import Gains
from maglev_env.rig import PRESETS, load_rig, rig_from_toml, with_parameters

TOML = """
schema = "maglev-rig/1"
name = "mine"
magnet = "none"
[parameters]
mass = 0.5
support_stiffness = 1e4
"""


def test_presets_load_and_carry_the_published_numbers():
    rigs = {name: load_rig(name) for name in PRESETS}
    assert rigs["hmb_free"].mass == 0.08012 and rigs["hmb_free"].actuator_gain == 5.7
    assert rigs["hmb_free"].negative_stiffness == -12.5e3 and rigs["hmb_free"].gap == 0.35e-3
    assert rigs["hmb_free"].gains == Gains(8000.0, 2000.0, 5.2, 1e-4, 0.0318)
    assert rigs["pedestal"].mass == 0.79 and rigs["pedestal"].support_stiffness == 134.5e3
    assert rigs["hmb_axial"].mass == 0.13 and rigs["hmb_radial"].mass == 0.92
    for rig in rigs.values():
        assert rig.protocol is not None and rig.clearance <= rig.gap


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('schema = "maglev-rig/1"', 'schema = "maglev-rig/9"', ["schema", "maglev-rig/1"]),
        ("mass = 0.5", "mass = 0", ["mass = 0 kg", "physical range"]),
        ("mass = 0.5", "mass = -1.0", ["mass = -1.0 kg", "physical range"]),
        ("mass = 0.5", "mass = nan", ["mass = nan", "finite"]),
        ("mass = 0.5", 'mass = "heavy"', ["mass = 'heavy'", "finite number"]),
        ("mass = 0.5", "", ["mass is missing"]),
        ("mass = 0.5", "mass = 0.5\nwheels = 4", ["unknown key 'wheels'", "support_stiffness"]),
        ("mass = 0.5", "mass = 0.5\nadc_bits = 2.5", ["adc_bits = 2.5", "whole number"]),
        ("mass = 0.5", "mass = 0.5\ngap = 1e-3\nclearance = 2e-3", ["clearance", "gap"]),
        ('magnet = "none"', 'magnet = "permanent"', ["magnet = 'permanent'", "hybrid_pair"]),
        ('magnet = "none"', 'magnet = "hybrid_pair"', ["remanence"]),
        ('magnet = "none"', 'magnet = "none"\naxes = 3', ["axes = 3"]),
        ('name = "mine"', "", ["name is missing"]),
        ("[parameters]", "[noise]\nsound = 1\n[parameters]", ["[noise]", "unknown key 'sound'"]),
        ("[parameters]", "[gains]\nkp = inf\nki = 1\nkd = 1\n[parameters]", ["kp = inf", "finite"]),
        ("[parameters]", "[tolerance]\nmass = 2\n[parameters]", ["[tolerance]", "mass = 2"]),
        ("[parameters]", "[protocol]\nperiods = 5\n[parameters]", ["[[protocol.excitation]]"]),
        ("[parameters]", "[parameters", ["line 5"]),
    ],
)
def test_a_bad_rig_is_refused_with_its_file_and_key(old, new, words):
    with pytest.raises(ValueError) as error:
        rig_from_toml(TOML.replace(old, new), "mine.toml")
    for word in ["mine.toml", *words]:
        assert word in str(error.value)


def test_a_rig_is_a_preset_or_a_toml_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(TOML)
    assert load_rig(path).mass == 0.5
    with pytest.raises(ValueError, match="neither a preset"):
        load_rig("hmb_fre")
    with pytest.raises(FileNotFoundError):
        load_rig(tmp_path / "missing.toml")
    path.write_text("x" * 2_000_000)
    with pytest.raises(ValueError, match="larger than"):
        load_rig(path)


def test_overrides_are_checked_and_move_the_clearance_with_the_gap():
    rig = with_parameters(load_rig("hmb_free"), {"gap": 0.5e-3})
    assert rig.clearance == 0.5e-3
    with pytest.raises(ValueError, match="unknown key 'weight'"):
        with_parameters(rig, {"weight": 1.0})
    with pytest.raises(ValueError, match="mass"):
        with_parameters(rig, {"mass": -1.0})


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), "8000", None, True])
def test_gains_must_be_numbers(bad):
    with pytest.raises(ValueError, match="kp"):
        Gains(bad, 1.0, 1.0)
    with pytest.raises(ValueError, match="td"):
        Gains(1.0, 1.0, 1.0, td=0.0)


def test_excitations_are_checked_and_must_interleave():
    a, b = Excitation("sphs", "force", 1.0, (1, 3)), Excitation("sphs", "current", 1.0, (2, 4))
    np.testing.assert_array_equal(lines_at((a, b)), [1, 2, 3, 4])
    np.testing.assert_array_equal(lines_at((a, b), "current"), [2, 4])
    for bad, words in (
        (lambda: Excitation("chirp", "force"), "kind"),
        (lambda: Excitation("sphs", "voltage"), "at"),
        (lambda: Excitation("sphs", "force", 1.0, (3, 1)), "increasing"),
        (lambda: Excitation("sphs", "force", 1.0, ()), "increasing"),
        (lambda: Excitation("sphs", "force", 0.0, (1,)), "fundamental"),
        (lambda: Excitation("sphs", "force", 1.0, (1,), float("nan")), "amplitude"),
        (lambda: Excitation("sphs", "force", 3.0, (1,)).waveform(20000.0), "whole number"),
        (lambda: Excitation("sphs", "force", 1.0, (10_000,)).waveform(20000.0), "not below half"),
        (lambda: check_interleaved((a, Excitation("sphs", "current", 1.0, (3,)))), "line 3 is excited at both"),
        (lambda: check_interleaved((a, Excitation("sphs", "current", 0.5, (2,)))), "fundamentals"),
    ):
        with pytest.raises(ValueError, match=re.escape(words)):
            bad()


def test_effects_parse_as_the_command_line_writes_them():
    assert parse_effect("delay=75e-6") == {"delay": {"time": 75e-6}}
    assert parse_effect("sensor_lag.time_constant=2e-5") == {"sensor_lag": {"time_constant": 2e-5}}
    assert parse_effects(["mass=0.1", "delay=1e-5"]) == {"mass": {"change": 0.1}, "delay": {"time": 1e-5}}
    for text, words in (
        ("friction=1", "unknown"),
        ("delay=fast", "not a number"),
        ("delay=1", "outside"),
        ("delay.speed=1e-5", "no parameter 'speed'"),
    ):
        with pytest.raises(ValueError, match=words):
            parse_effect(text)
    with pytest.raises(ValueError, match="twice"):
        parse_effects(["delay=1e-5", "delay=2e-5"])


@given(st.sampled_from(sorted(EFFECTS)), st.floats(-10, 10))
def test_an_effect_is_inside_its_bounds_or_refused(name, value):
    parameter = next(iter(EFFECTS[name].parameters.values()))
    if parameter.low <= value <= parameter.high:
        assert effect(name, value)[name] == {next(iter(EFFECTS[name].parameters)): value}
    else:
        with pytest.raises(ValueError, match=name):
            effect(name, value)


def test_an_experiment_that_cannot_run_is_refused():
    e = protocol_experiment(load_rig("hmb_free"))
    with pytest.raises(ValueError, match="periodic excitation"):
        _ = Experiment(e.rig, e.gains, ()).samples_per_period
    with pytest.raises(ValueError, match="beyond the clearance"):
        Experiment(e.rig, e.gains, e.excitations, offset=1e-3)
    with pytest.raises(ValueError, match="periods"):
        Experiment(e.rig, e.gains, e.excitations, periods=0)
