"""Rigs, gains, excitations and effects at their boundary, and the presets' numbers against the published ones."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.lanes import structure_of
from maglev_env.loop.card import SLOWEST
from maglev_env.loop.effect import EFFECTS, effect, parse_effect, parse_effects
from maglev_env.loop.gains import Gains, LinearController
from maglev_env.rig.excitation import Excitation, check_interleaved, lines_at
from maglev_env.rig.rig import axis_rig, with_parameters
from maglev_env.rig.rig_file import PRESETS, load_rig, rig_from_toml

TOML = """
schema = "maglev-rig/1"
name = "mine"
magnet = "none"
[parameters]
mass = 0.5
support_stiffness = 1e4
"""


SAMPLED = """schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
[parameters]
mass = 0.02
gap = 5e-3
turns = 1000
pole_area = 1e-4
control_rate = {rate}
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


def test_a_default_target_band_is_an_octave_where_the_loop_lies_below_half_of_the_control_rate():
    """A ball that an inverse square pulls runs away at sqrt(2 g / gap), here 9.97 Hz from 5 mm."""
    ball, slow = rig_from_toml(SAMPLED.format(rate=1000), "ball"), rig_from_toml(SAMPLED.format(rate=200), "ball")
    assert ball.target.band == slow.target.band == (10.0, 20.0)
    assert with_parameters(ball, {"control_rate": 40.0}).target.band == (5.0, 10.0)
    assert with_parameters(slow, {"control_rate": 1000.0}).target.band == (10.0, 20.0)
    with pytest.raises(ValueError, match="does not lie below half of the control rate of 200 Hz; leave it out"):
        rig_from_toml(SAMPLED.format(rate=200) + "[target]\nband = [60.0, 120.0]\n", "ball")


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
        ("[parameters]", "[target]\nband = [-5, 20]\n[parameters]", ["[target]: band = [-5, 20]", "above 0"]),
        ("[parameters]", "[target]\nband = [0, 20]\n[parameters]", ["[target]: band = [0, 20]", "above 0"]),
        ("[parameters]", "[parameters", ["line 5"]),
    ],
)
def test_a_bad_rig_is_refused_with_its_file_and_key(old, new, words):
    with pytest.raises(ValueError) as error:
        rig_from_toml(TOML.replace(old, new), "mine.toml")
    for word in ["mine.toml", *words]:
        assert word in str(error.value)


def test_the_coil_of_a_large_levitation_magnet_may_be_slow():
    coil = {"coil_inductance": 1.0, "coil_resistance": 4.0, "amplifier_time_constant": 0.25}
    assert with_parameters(load_rig("hmb_free"), coil).amplifier_time_constant == 0.25


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
        ("gremlins=1", "unknown"),
        ("delay=fast", "not a number"),
        ("delay=100", "outside"),
        ("delay.speed=1e-5", "no parameter 'speed'"),
        ("delay.time=1e-4,time=2e-4", "time is given twice"),
        ("delay=1e-4,time=2e-4", "time is given twice"),
        ("friction=0.1,velocity=1e-3,velocity=2e-3", "velocity is given twice"),
    ):
        with pytest.raises(ValueError, match=words):
            parse_effect(text)
    with pytest.raises(ValueError, match="twice"):
        parse_effects(["delay=1e-5", "delay=2e-5"])


@settings(deadline=None)
@given(st.sampled_from(sorted(EFFECTS)), st.floats(-10, 10))
def test_an_effect_is_inside_its_bounds_or_refused(name, value):
    first, parameter = next((key, p.on(SLOWEST)) for key, p in EFFECTS[name].parameters.items())
    given_too = {k: 75.0 for k, p in EFFECTS[name].parameters.items() if p.default is None and k != first}
    if parameter.low <= value <= parameter.high or value == parameter.absent:
        made = effect(name, value, **given_too)[name]
        assert made[first] == value
        assert all(made[k] == p.default for k, p in EFFECTS[name].plain.items() if k != first)
    else:
        with pytest.raises(ValueError, match=name):
            effect(name, value, **given_too)


def test_an_experiment_that_cannot_run_is_refused():
    e = protocol_experiment(load_rig("hmb_free"))
    with pytest.raises(ValueError, match="periodic excitation"):
        _ = Experiment(e.rig, e.gains, ()).samples_per_period
    with pytest.raises(ValueError, match="beyond the clearance"):
        Experiment(e.rig, e.gains, e.excitations, offset=1e-3)
    with pytest.raises(ValueError, match="periods"):
        Experiment(e.rig, e.gains, e.excitations, periods=0)
    slanted = (replace(e.excitations[0], direction=30.0),)
    with pytest.raises(ValueError, match="hmb_free has one axis: a direction is 0, or 180"):
        Experiment(e.rig, e.gains, slanted)
    with pytest.raises(ValueError, match="hmb_free has one axis; give one controller"):
        Experiment(e.rig, (e.gains, e.gains), e.excitations)
    with pytest.raises(ValueError, match="pedestal has no magnets: only a force can excite it"):
        Experiment(load_rig("pedestal"), e.gains, e.excitations)
    filtered = LinearController((1.0,), (1.0, -0.5))
    with pytest.raises(ValueError, match="both axes PID gains, or both a linear controller"):
        structure_of(Experiment(load_rig("hmb_radial"), (e.gains, filtered), e.excitations))


@pytest.mark.parametrize("rate", [30_000.0, 12_345.0, 19_999.0])
def test_a_recording_has_an_integer_multiple_or_fraction_of_the_control_rate(rate):
    e = protocol_experiment(load_rig("hmb_free"))
    with pytest.raises(ValueError, match=r"neither a multiple nor an integer fraction of control_rate = 20000"):
        replace(e, sample_rate=rate)
    assert replace(e, sample_rate=60_000.0).recorded_per_period == 60_000
    assert replace(e, sample_rate=20_000.0 / 3).recorded_rate == pytest.approx(6666.67)


@pytest.mark.parametrize("rate", [float("nan"), float("inf"), -20_000.0, 0.0, True])
def test_a_recorded_rate_is_a_positive_number(rate):
    with pytest.raises(ValueError, match=f"sample_rate = {rate} Hz must be a positive number"):
        replace(protocol_experiment(load_rig("hmb_free")), sample_rate=rate)


@pytest.mark.parametrize(("rate", "line"), [(1e-9, 249), (400.0, 249), (2000.0, 2000), (4000.0, 2000)])
def test_a_recorded_rate_resolves_every_line(rate, line):
    e = protocol_experiment(load_rig("hmb_free"))  # at 2000 Hz an injection at 2000 Hz would be seen at 0 Hz
    with pytest.raises(ValueError, match=rf"line {line} \({line} Hz\) is not below half .*it would fold back"):
        replace(e, sample_rate=rate)
    assert replace(e, sample_rate=5000.0).recorded_rate == 5000.0


PLANAR = """
schema = "maglev-rig/1"
name = "mine"
magnet = "hybrid_pair"
axes = 2
[parameters]
mass = 0.9
remanence = 0.7
support_stiffness = 1e5
[axis.x]
support_damping = 3.0
[axis.y]
mass = 1.1
support_stiffness = 2e5
[cross]
stiffness_xy = 50.0
damping_yx = -0.2
[gains.x]
kp = 1.0
ki = 2.0
kd = 3.0
[gains.y]
kp = 4.0
ki = 5.0
kd = 6.0
td = 2e-4
[protocol]
band_width = 10.0
band_overlap = 0.0
[[protocol.excitation]]
kind = "sphs"
direction = 60.0
amplitude = 2.0
lines = [1, 2, 4]
[[protocol.excitation]]
kind = "multisine"
at = "current"
direction = 90.0
lines = [3]
seed = 5
"""


def test_an_axis_is_a_rig_of_its_own():
    rig = rig_from_toml(PLANAR, "mine.toml")
    x, y = (axis_rig(rig, axis) for axis in range(2))
    assert (rig.axes, x.axes, y.axes) == (2, 1, 1) and x.cross == y.cross != rig.cross
    assert (x.mass, x.support_stiffness, x.support_damping) == (0.9, 1e5, 3.0)
    assert (y.mass, y.support_stiffness, y.support_damping) == (1.1, 2e5, 0.0)
    assert x.gains == Gains(1.0, 2.0, 3.0) and y.gains == Gains(4.0, 5.0, 6.0, 2e-4)
    assert [(e.at, e.seed) for e in x.protocol.excitations] == [("force", 0)]
    assert [(e.at, e.seed) for e in y.protocol.excitations] == [("force", 0), ("current", 5)]
    assert x.protocol.excitations[0].amplitude == pytest.approx(1.0)
    assert y.protocol.excitations[0].amplitude == pytest.approx(np.sqrt(3))
    # force on x of -stiffness_xy times y: stiffness, damping, gain, sensor of the other axis
    assert rig.cross.onto(0) == (50.0, 0.0, 0.0, 0.0) and rig.cross.onto(1) == (0.0, -0.2, 0.0, 0.0)
    assert axis_rig(x, 1) is x


def test_one_controller_serves_both_axes_unless_each_has_its_own():
    cut, rest = PLANAR.index("[gains.x]"), PLANAR[PLANAR.index("[protocol]") :]
    one = rig_from_toml(PLANAR[:cut] + "[gains]\nkp = 1.0\nki = 2.0\nkd = 3.0\n" + rest, "mine.toml")
    assert one.gains == axis_rig(one, 0).gains == axis_rig(one, 1).gains == Gains(1.0, 2.0, 3.0)
    tables = "[gains.x]\nnumerator = [2.0]\ndenominator = [1, -0.5]\n[gains.y]\nnumerator = [1]\ndenominator = [1]\n"
    pair = rig_from_toml(PLANAR[:cut] + tables + rest, "mine.toml")
    assert pair.gains == (LinearController((2.0,), (1, -0.5)), LinearController((1,), (1,)))
    none = rig_from_toml(PLANAR[:cut] + rest, "mine.toml")
    assert none.gains is None and axis_rig(none, 1).gains is None


ONE = PLANAR.replace("axes = 2", "axes = 1")
WITHOUT_AXIS = ONE[: ONE.index("[axis.x]")] + ONE[ONE.index("[cross]") :]
BALL = """schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
[parameters]
mass = 0.058
gap = 10e-3
turns = 1000
pole_area = 3e-4
"""
CONTROLLER = "[gains]\nnumerator = [1]\ndenominator = [1]\n[parameters]"


@pytest.mark.parametrize(
    ("text", "old", "new", "words"),
    [
        (PLANAR, "axes = 2", "axes = 0", ["axes = 0", "2 for x and y"]),
        (ONE, "", "", ["[axis], [cross] and gains per axis need axes = 2"]),
        (WITHOUT_AXIS, "", "", ["[axis], [cross] and gains per axis need axes = 2"]),
        (PLANAR, "[axis.y]", "[axis.z]", ["[axis]: unknown key 'z'", "known keys: x, y"]),
        (PLANAR, "mass = 1.1", "wheels = 4", ["[axis.y]: unknown key 'wheels'", "support_stiffness"]),
        (PLANAR, "mass = 1.1", "control_rate = 1000.0", ["[axis.y]: unknown key 'control_rate'"]),
        (PLANAR, "mass = 1.1", "clearance = 1e-4", ["[axis.y]: unknown key 'clearance'"]),
        (PLANAR, "mass = 1.1", "gravity = 0.0", ["[axis.y]: unknown key 'gravity'"]),
        (PLANAR, "mass = 1.1", 'flux_path = "magnet"', ["[axis.y]: unknown key 'flux_path'"]),
        (PLANAR, "mass = 1.1", "adc_bits = 12", ["[axis.y]: unknown key 'adc_bits'"]),
        (PLANAR, "mass = 1.1", "dac_bits = 12", ["[axis.y]: unknown key 'dac_bits'"]),
        (PLANAR, "mass = 1.1", "mass = -1.1", ["mass = -1.1 kg", "physical range"]),
        (PLANAR, "stiffness_xy = 50.0", "stiffness = 50.0", ["[cross]: unknown key 'stiffness'", "stiffness_xy"]),
        (PLANAR, "stiffness_xy = 50.0", "stiffness_xy = nan", ["[cross]: stiffness_xy = nan", "finite number"]),
        (PLANAR, "stiffness_xy = 50.0", "stiffness_xy = [5]", ["[cross]: stiffness_xy = [5]", "finite number"]),
        (PLANAR, "stiffness_xy = 50.0", "stiffness_xy = true", ["[cross]: stiffness_xy = True"]),
        (PLANAR, PLANAR[PLANAR.index("[gains.y]") : PLANAR.index("[proto")], "", ["gains: axis y has none", "gains.y"]),
        (PLANAR, "[gains.y]", "[gains.z]", ["gains: unknown key 'z'", "x, y"]),
        (PLANAR, "kp = 4.0", "", ["gains.y: kp missing"]),
        (PLANAR, "kp = 4.0", "numerator = [1]", ["gains.y: unknown key 'ki'", "denominator, limit, numerator"]),
        (PLANAR, "direction = 60.0", "direction = inf", ["direction = inf", "degrees"]),
        (PLANAR, "seed = 5", "band = [1.0, 5.0]", ["band = (1.0, 5.0) Hz", "recorded one"]),
        (PLANAR, 'kind = "sphs"', 'kind = "recorded"\nband = [-1, 5]', ["band = (-1, 5) Hz", "two increasing"]),
        (PLANAR, "lines = [3]", "lines = [2]", ["line 2 is excited"]),
        (TOML, "[parameters]", CONTROLLER.replace("[1]\n[par", "[2]\n[par"), ["starts with 2, not 1", "divide"]),
        (TOML, "[parameters]", CONTROLLER.replace("[1]\n[par", "[0, 1]\n[par"), ["starts with 0", "leading zeros"]),
        (TOML, "[parameters]", CONTROLLER.replace("[1]\nden", "[1, 2]\nden"), ["would need the future"]),
        (TOML, "[parameters]", CONTROLLER.replace("[1]\nden", "[inf]\nden"), ["numerator = (inf,)", "highest power"]),
        (TOML, "[parameters]", CONTROLLER.replace("numerator = [1]", ""), ["gains: numerator missing"]),
        (TOML, "[parameters]", CONTROLLER.replace("numerator", "kp"), ["gains: unknown key 'kp'"]),
        (
            BALL,
            "gap",
            "bias_current = 0.5\ngap",
            ["bias_current = 0.5 A pulls 0.236 N", "the weight is 0.569 N", "0.777 A"],
        ),
        (BALL, "gap", "bias_current = 0.79\ngap", ["bias_current = 0.79 A", "leave bias_current out"]),
        (
            BALL,
            "turns = 1000\npole_area = 3e-4",
            "turns = 1\npole_area = 3e-5",
            ["2.46e+03 A would balance the weight", "correct turns, pole_area, gap or mass"],
        ),
        (BALL, "gap", "gravity = 0.0\ngap", ["gravity = 0: electromagnet pulls one way only"]),
        (BALL, "[par", "axes = 2\n[par", ["axes = 2", "electromagnet carries a weight along one axis"]),
        (BALL, "gap", "remanence = 0.5\ngap", ["remanence = 0.5 T", "no permanent magnet"]),
        (BALL, '"electromagnet"', '"magnet_coil"', ["force_constant is missing", "magnet_coil"]),
        (BALL, '"electromagnet"', '"electromagnet_pair"', ["bias_current: an electromagnet_pair needs one"]),
    ],
)
def test_a_bad_axis_controller_or_magnet_is_refused_with_its_file_and_key(text, old, new, words):
    assert old in text
    with pytest.raises(ValueError) as error:
        rig_from_toml(text.replace(old, new, 1), "mine.toml")
    for word in ["mine.toml", *words]:
        assert word in str(error.value)


def test_a_bias_within_a_percent_of_the_weight_and_a_campaigns_mass_beside_it():
    rig = rig_from_toml(BALL.replace("gap", "bias_current = 0.78\ngap", 1), "ball.toml")
    with pytest.raises(ValueError, match=r"bias_current = 0\.78 A pulls 0\.573 N.*the weight is 0\.686 N"):
        with_parameters(rig, {"mass": 0.07})
    assert with_parameters(rig_from_toml(BALL, "ball.toml"), {"mass": 0.07}).mass == 0.07


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("mass = 1.1", "mass = -1.1", "axis.y"),
        ("kp = 4.0", "kp = inf", "gains.y"),
        ("axes = 2", "axes = 2.0", "axes = 2.0"),
        ("[axis.x]\nsupport_damping = 3.0", "[axis]\nx = 5", "axis.x"),
        ("[cross]\nstiffness_xy = 50.0\ndamping_yx = -0.2", "", "cross"),
        ("direction = 60.0", 'direction = "up"', "direction"),
        ("direction = 60.0", "direction = " + "9" * 400, "direction"),
        ("lines = [3]", 'lines = ["x"]', "lines"),
        ("lines = [3]", 'harmonics = [3, "x"]', "harmonics"),
        ("amplitude = 2.0", "amplitude = [2.0]", "amplitude"),
        ("band_width = 10.0", 'band_width = "x"', "band_width"),
    ],
)
def test_a_wrong_type_names_its_key(old, new, word):
    text = PLANAR.replace(old, new, 1)
    if word == "cross":
        text = text.replace("axes = 2", 'axes = 2\ncross = ""')
    with pytest.raises(ValueError, match=re.escape(word)):
        rig_from_toml(text, "mine.toml")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('name = "mine"', "name = 5"),
        ("lines = [3]", "lines = [3.7]"),
        ("lines = [3]", 'lines = ["3"]'),
        ("lines = [3]", "harmonics = [30, 37.9]"),
        ("seed = 5", "seed = [5]"),
        ("seed = 5", 'seed = "x"'),
        ("seed = 5", "seed = -1"),
        ("[protocol]", "[protocol]\nperiods = 5.5"),
        ("[protocol]", "[protocol]\nperiods = inf"),
        ("[protocol]", "[protocol]\ntransient_periods = nan"),
        ("[protocol]", '[target]\nstiffness = "x"\n[protocol]'),
        ("[protocol]", "[target]\npeak_sensitivity = -1\n[protocol]"),
        ("[protocol]", '[target]\nband = ["a", "b"]\n[protocol]'),
        ("[protocol]", '[bounds]\nkp = ["a", "b"]\n[protocol]'),
        ("[protocol]", "[noise]\nforce = true\n[protocol]"),
        ("kp = 1.0\nki = 2.0\nkd = 3.0", "numerator = [true]\ndenominator = [true]"),
    ],
)
def test_a_value_of_another_type_is_not_let_in(old, new):
    with pytest.raises(ValueError):
        rig_from_toml(PLANAR.replace(old, new, 1), "mine.toml")


def test_a_direction_needs_two_axes():
    text = TOML + '[[protocol.excitation]]\nkind = "sphs"\nlines = [1]\ndirection = 30.0\n'
    with pytest.raises(ValueError, match="direction"):
        rig_from_toml(text, "mine.toml")


def test_a_slip_of_the_pen_takes_no_gigabytes():
    with pytest.raises(ValueError, match="1500000"):
        rig_from_toml(PLANAR.replace("lines = [3]", "harmonics = [3, 1500000]"), "mine.toml")


HOSTILE = (
    '"x"', '""', "true", "[]", "{}", "[{}]", "nan", "-inf", "0", "-1", "1e308", "9" * 30, "1979-05-27", "[nan, inf]",
    '["a", "b"]', "[[1], [2]]", "[2, 1]", "[" * 80 + "]" * 80, "{ x = { x = 1 }, y = 2 }",
)  # fmt: skip


@pytest.mark.parametrize("number", [i for i, line in enumerate(PLANAR.splitlines()) if " = " in line])
def test_no_value_of_any_key_ends_in_another_error(number):
    lines = PLANAR.splitlines()
    key = lines[number].partition(" = ")[0]
    for value in HOSTILE:
        lines[number] = f"{key} = {value}"
        try:
            rig_from_toml("\n".join(lines), "mine.toml")
        except ValueError as error:
            assert "mine.toml" in str(error)


def test_no_huge_number_ends_in_another_error():
    lines = PLANAR.splitlines()
    for number in [i for i, line in enumerate(lines) if " = " in line]:
        huge = [*lines[:number], lines[number].partition(" = ")[0] + " = " + "9" * 400, *lines[number + 1 :]]
        try:
            rig_from_toml("\n".join(huge), "mine.toml")
        except ValueError as error:
            assert "mine.toml" in str(error)


TABLES = ("parameters", "axis", "cross", "gains", "noise", "bounds", "protocol", "target", "tolerance")


@pytest.mark.parametrize("name", TABLES)
def test_no_value_in_the_place_of_a_table_ends_in_another_error(name):
    for value in HOSTILE:
        text = TOML if name == "parameters" else TOML + "support_damping = 1.0\n"
        text = text.replace("[parameters]", "[noise]") if name == "parameters" else text
        head = text.replace('magnet = "none"', f'magnet = "none"\n{name} = {value}')
        try:
            rig_from_toml(head, "mine.toml")
        except ValueError as error:
            assert "mine.toml" in str(error)


def test_deep_nesting_is_a_value_error():
    with pytest.raises(ValueError, match=r"mine\.toml"):
        rig_from_toml(TOML + "gap = " + "[" * 5000, "mine.toml")


@pytest.mark.parametrize("excitation", ["[5]", "5", '"sphs"', "{ kind = 5 }"])
def test_an_excitation_that_is_no_table_is_refused(tmp_path, excitation):
    path = tmp_path / "mine.toml"
    text = 'schema = "maglev-rig/1"\nname = "mine"\nmagnet = "none"\n[parameters]\nmass = 1.0\n[protocol]\n'
    path.write_text(f"{text}excitation = {excitation}\n")
    with pytest.raises(ValueError, match=r"mine\.toml: .*excitation"):
        load_rig(path)


def test_controllers_that_are_none_are_refused():
    e = protocol_experiment(load_rig("hmb_free"))
    with pytest.raises(ValueError, match=r"gains = \{'kp': 1\.0\}; give Gains\(kp"):
        replace(e, gains={"kp": 1.0})
