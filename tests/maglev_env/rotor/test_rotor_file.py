"""Rotor files: what is read, and what is refused with which words."""

from dataclasses import replace
from importlib import resources
from math import log

import pytest

from maglev_env.rig.rig_file import load_rig
from maglev_env.rotor.parts import Axial, Body, Rejection, Touchdown
from maglev_env.rotor.rotor import hollow_cylinder, load_rotor

TEXT = (resources.files("maglev_env") / "rotors" / "pump.toml").read_text()


def changed(tmp_path, old: str, new: str):
    assert old in TEXT
    path = tmp_path / "mine.toml"
    path.write_text(TEXT.replace(old, new))
    return path


def test_the_preset_is_the_cylinder_it_says():
    body = load_rotor("pump").body
    transverse, polar = hollow_cylinder(body.mass, 7.4e-3, 10.15e-3, 70e-3)
    assert (body.transverse_inertia, body.polar_inertia) == (
        pytest.approx(transverse, rel=1e-3),
        pytest.approx(polar, rel=1e-3),
    )
    assert load_rotor("pump").axis == load_rig("hmb_free")


def test_a_thin_rod_and_a_disc():
    assert hollow_cylinder(1.0, 0.0, 0.0, 2.0) == (pytest.approx(1 / 3), 0.0)
    transverse, polar = hollow_cylinder(2.0, 0.0, 0.1, 0.0)
    assert polar == pytest.approx(2 * transverse) == pytest.approx(0.01)


def test_axial_stiffness_is_the_slope_through_the_centre():
    z = (0.0, 1e-5, 2e-5)
    assert Axial(z, tuple(0.3 - 4e3 * v for v in z)).stiffness == pytest.approx(4e3)


@pytest.mark.parametrize("restitution", [0.1, 0.5, 0.9, 1.0])
def test_contact_damping_keeps_the_energy_integral(restitution):
    touch = Touchdown(restitution=restitution, speed=0.7)
    a = touch.damping * touch.speed
    assert log(1 + a) - a == pytest.approx(log(1 - restitution * a) + restitution * a, abs=1e-9)
    assert (a > 0.05) == (restitution < 1)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('schema = "maglev-rotor/1"', 'schema = "maglev-rig/1"', "maglev-rotor/1"),
        ("polar_inertia = 6.321e-6", "polar_inertia = 8.0e-5", "triangle inequality"),
        ("mass = 0.08012", "mass = -1.0", "physical range"),
        ("mass = 0.08012", 'mass = "heavy"', "not a finite number"),
        ("radius = 10.15e-3", "radius = [5]", "radius = .* is not a finite number"),
        ("restitution = 0.6", "restitution = [0.6, 0.6]", "restitution = .* is not a finite number"),
        ("magnets = [-0.027, 0.027]", "magnets = [0.027, -0.027]", "bearing a comes before b"),
        ("magnets = [-0.027, 0.027]", "magnets = [-0.027]", "two positions"),
        ("[gains.tilt]", "[gains.b]", "translation and tilt"),
        ("gravity = [0.0, -9.80665, 0.0]", "gravity = [0.0, 0.0, 90.0]", "beyond the passive force"),
        ("gravity = [0.0, -9.80665, 0.0]", "gravity = 9.81", "three accelerations"),
        ("static = 4.5e-8", "statics = 4.5e-8", "unknown key 'statics'"),
        ('axis = "hmb_free"', 'axis = "hmb_radial"', "not one axis of a pair"),
        ("force = [-0.12949, ", "force = [", "as many"),
        ("[fluid]", "[fluids]", "unknown key 'fluids'"),
        ("[fluid]", "[rejection]\nrate = -1.0\n[fluid]", "rate = -1.0"),
        ("[fluid]", "[rejection]\nspeed = 1.0\n[fluid]", "unknown key 'speed'"),
        ("kp = 8000.0", "kp = inf", "not a finite number"),
    ],
)
def test_what_cannot_be_is_refused_by_name(tmp_path, old, new, words):
    path = changed(tmp_path, old, new)
    with pytest.raises(ValueError, match=words) as error:
        load_rotor(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"support_stiffness": 5e4}, r"rig hmb_free states support_stiffness, which"),
        ({"support_damping": 20.0, "effects": {"delay": {"time": 3e-4}}}, r"support_damping, \[effects.delay\], which"),
    ],
)
def test_what_no_rotor_has_is_not_left_out_of_its_axis_in_silence(stated, words):
    with pytest.raises(ValueError, match=words):
        replace(load_rotor("pump"), axis=replace(load_rotor("pump").axis, **stated))


def test_force_rejection_is_read_from_the_file(tmp_path):
    path = changed(tmp_path, "[fluid]", "[rejection]\nrate = 5\nfrom_speed = 1000\n[fluid]")
    assert load_rotor("pump").rejection is None
    assert load_rotor(path).rejection == Rejection(5, 1000)


def test_a_rotor_is_no_rig_and_says_where_to_go():
    with pytest.raises(ValueError, match="runup"):
        load_rig("pump")
    with pytest.raises(ValueError, match="neither a preset"):
        load_rotor("hmb_free")
    with pytest.raises(ValueError, match="no body"):
        Body(1.0, 1.0, 2.1, 0.1)


@pytest.mark.parametrize("table", ["bounds = 2", "fluid = false", 'touchdown = "x"', "gains = [1]"])
def test_what_is_no_table_is_refused_by_name(tmp_path, table):
    name = table.partition(" = ")[0]
    head, *blocks = TEXT.split("\n[")
    kept = [block for block in blocks if not block.startswith((f"{name}]", f"{name}."))]
    path = tmp_path / "mine.toml"
    path.write_text("\n[".join([f"{table}\n{head}", *kept]))
    with pytest.raises(ValueError, match=rf"mine\.toml: \[{name}\] = .* must be a table"):
        load_rotor(path)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("[runout]\nphase = 3.0", "phase = 3.0 must be a list"),
        ("[runout]\nphase = ['x', 'y']", "not a finite number"),
        ("[runout]\namplitude = [1e-6]", "two amplitudes and two phases"),
    ],
)
def test_a_runout_has_two_amplitudes_and_two_phases(tmp_path, table, words):
    path = tmp_path / "mine.toml"
    blocks = [block for block in TEXT.split("\n[") if not block.startswith("runout]")]
    path.write_text("\n[".join(blocks) + f"\n{table}\n")
    with pytest.raises(ValueError, match=words):
        load_rotor(path)


@pytest.mark.parametrize(
    ("at", "force"), [((1e-4, 2e-4), (-1.0, -2.0)), ((-1e-4, 1e-4), (1.3, -0.7)), ((0.0, 1e-4), (0.3, -0.7))]
)
def test_an_axial_curve_that_does_not_hold_the_rest_has_no_offset_to_take_off(at, force):
    """Ten newtons a millimetre, measured on one side or on both; a force sensor that is off shows at rest."""
    assert Axial(at, force).stiffness == pytest.approx(1e4)
