"""Probes that are turned against the coils, on two loops solved line by line from their difference equations."""

import re

import numpy as np
import pytest

from maglev_env.recordings.campaign import load_campaign
from maglev_env.redundancy.rules import examine

RATE, N, PERIODS, FUNDAMENTAL = 10_000.0, 2000, 5, 5.0
KP, KI, KD, TD, LAG = 12_000.0, 50_000.0, 22.0, 1e-4, 1.6e-4
MASS, GAIN, STIFFNESS = 4.0, 187.5, -1.17e6
RIG = f"""schema = "maglev-rig/1"
name = "radial"
magnet = "electromagnet_pair"
axes = 2
[parameters]
mass = {MASS}
gap = 0.4e-3
clearance = 0.3e-3
bias_current = 2.5
actuator_gain = {GAIN}
negative_stiffness = {STIFFNESS}
amplifier_time_constant = {LAG}
probe_gain = 20000.0
adc_bits = 0
dac_bits = 0
control_rate = {RATE}
[gains]
form = "pid"
kp = {KP}
ki = {KI}
kd = {KD}
td = {TD}
"""
LINES = (np.arange(2, 80, 2), np.arange(3, 80, 2))  # of x and y


def controller(z):
    """The PID, A/m: backward differences of the filtered derivative and of the integral."""
    back = 1 - 1 / z
    return KP + KI / RATE / back + KD * back / (TD * back + 1 / RATE)


def rotation(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])


def loops(probes, cross=0.0, axes=(0, 1), seed=4):
    """Channels of both axes: the rotor's displacement x, what probes (2, 2) read of it, command and current.

    The program reads the rotor along the coils, by weights that undo the probes; cross: stiffness across the axes, N/m.
    """
    rng, f = np.random.default_rng(seed), FUNDAMENTAL * np.arange(1, N // 2 + 1)
    s, z = 2j * np.pi * f, np.exp(2j * np.pi * f / RATE)
    pole = np.exp(-1 / RATE / LAG)
    amplifier = (1 - pole) / z / (1 - pole / z)
    c, found = controller(z), {name: np.zeros((2, f.size), complex) for name in ("x", "u", "i", "w")}
    for axis in axes:
        found["w"][axis, LINES[axis] - 1] = 0.02 * np.exp(2j * np.pi * rng.random(LINES[axis].size))
    for k in np.flatnonzero(np.abs(found["w"]).any(axis=0)):
        spring = np.array([[MASS * s[k] ** 2 + STIFFNESS, cross], [-cross, MASS * s[k] ** 2 + STIFFNESS]])
        force = GAIN * amplifier[k]
        found["x"][:, k] = np.linalg.solve(spring + force * c[k] * np.eye(2), force * found["w"][:, k])
        found["u"][:, k] = found["w"][:, k] - c[k] * found["x"][:, k]
        found["i"][:, k] = amplifier[k] * found["u"][:, k]

    def series(spectra, noise):
        whole = np.fft.irfft(np.concatenate([np.zeros((2, 1)), spectra * (N / 2)], axis=1), N, axis=1)
        return np.tile(whole, PERIODS) + noise * rng.normal(size=(2, PERIODS * N))

    return {
        "p": series(np.asarray(probes) @ found["x"], 1e-10),
        "command": series(found["u"], 1e-6),
        "current": series(found["i"], 1e-6),
        "injection": series(found["w"], 1e-9),
    }


def examined(folder, channels, weights, names=("command", "current"), axes=(0, 1), gains=True):
    """The findings of a campaign whose displacements are the probes by these weights (2, 2)."""
    (folder / "rig.toml").write_text(RIG if gains else RIG.partition("[gains]")[0])
    columns = {f"{name}{axis}": channels[name][axis] for name in channels for axis in range(2)}
    np.savez(folder / "run.npz", **columns)
    text = ['schema = "maglev-campaign/1"', 'rig = "rig.toml"', "[[recording]]", 'file = "run.npz"']
    text += [f"sample_rate = {RATE}"]
    text += [f'controller = {{ form = "pid", kp = {KP}, ki = {KI}, kd = {KD}, td = {TD} }}'] if gains else []
    for axis in axes:
        peak = np.abs(channels["injection"][axis]).max()
        text += ["[[recording.excitation]]", 'kind = "multisine"', 'at = "current"', f"fundamental = {FUNDAMENTAL}"]
        text += [
            f"lines = {LINES[axis].tolist()}",
            f"amplitude = {peak:.4g}",
            f"direction = {90.0 * axis}",
            "periods = 5",
        ]
    text += ["[recording.channels]"]
    for axis, letter in enumerate("xy"):
        text += [f'displacement_{letter} = {{ from = ["p0", "p1"], weights = {np.asarray(weights)[axis].tolist()} }}']
        text += [f'{name}_{letter} = {{ from = "{name}{axis}" }}' for name in (*names, "injection")]
    (folder / "campaign.toml").write_text("\n".join(text))
    return examine(load_campaign(folder))


def weights_of(finding):
    """The weights (2, 2) that a finding asks for."""
    return [[float(w) for w in row.split(",")] for row in re.findall(r"weights = \[(.*?)\]", finding.message)]


@pytest.mark.parametrize(("degrees", "scale"), [(45.0, 1.0), (45.0, np.sqrt(2.0)), (-8.0, 1.0), (2.0, 1.0)])
def test_probes_that_are_turned_are_named_with_their_angle_and_weights(tmp_path, degrees, scale):
    channels = loops(rotation(-degrees))
    (one,) = (f for f in examined(tmp_path, channels, scale * np.eye(2)) if f.code == "turned")
    assert one.kind == "contradiction" and one.value == pytest.approx(degrees, abs=0.1)
    assert f"rotated by {abs(degrees):g} degrees" in one.message
    np.testing.assert_allclose(weights_of(one), rotation(degrees), atol=3e-3)


def test_sound_axes_say_nothing_although_their_rotor_couples_them(tmp_path):
    for cross in (0.0, 3e5):
        channels = loops(rotation(-45.0), cross)
        for names in (("command", "current"), ("current",), ("command",)):
            found = examined(tmp_path, channels, rotation(45.0), names)
            assert not [f for f in found if f.code == "turned" or f.channel == "axes"], (cross, names)


@pytest.mark.parametrize("names", [("current",), ("command",)])
@pytest.mark.parametrize("axes", [(0, 1), (0,)])
def test_the_lines_of_the_other_axis_tell_beside_currents_or_where_one_axis_is_excited(tmp_path, names, axes):
    found = examined(tmp_path, loops(rotation(-30.0), axes=axes), np.eye(2), names, axes)
    (one,) = (f for f in found if f.code == "turned")
    assert one.value == pytest.approx(30.0, abs=0.5)
    np.testing.assert_allclose(weights_of(one), rotation(30.0), atol=3e-3)
    assert one.kind == ("wiring" if names == ("current",) else "contradiction")


def test_a_reversed_probe_of_two_is_named_by_the_weights_that_mend_it(tmp_path):
    channels = loops(np.diag([-1.0, 1.0]) @ rotation(-45.0))
    (one,) = (f for f in examined(tmp_path, channels, rotation(45.0)) if f.code == "turned")
    np.testing.assert_allclose(weights_of(one), [[-0.707, -0.707], [-0.707, 0.707]], atol=3e-3)


def test_exchanged_axes_are_left_to_the_rule_that_names_them(tmp_path):
    channels = loops(np.eye(2))
    assert examined(tmp_path, channels, np.eye(2)[::-1])[0].code == "swapped"


@pytest.mark.parametrize(("names", "gains"), [((), True), (("current",), False)])
def test_where_nothing_shows_the_axes_it_is_said(tmp_path, names, gains):
    found = examined(tmp_path, loops(np.eye(2)), np.eye(2), names, gains=gains)
    (one,) = (f for f in found if f.channel == "axes")
    assert one.kind == "not checkable" and "axes of the probes" in one.message
