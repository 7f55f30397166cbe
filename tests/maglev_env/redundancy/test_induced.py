"""A ball below a coil under a voltage: what its motion induces in the current is no AC coupling, and hides nothing.

The ball is a linear system of position, velocity and current, advanced by its matrix exponential; its program is a PID.
"""

import numpy as np
import pytest
import scipy

from maglev_env.recordings.campaign import load_campaign
from maglev_env.redundancy.rules import examine

RATE, MASS, RESISTANCE, INDUCTANCE, BIAS = 2000.0, 0.1, 6.0, 0.07, 1.2
GAP = 8e-3
GAIN, STIFFNESS = 2 * MASS * 9.80665 / BIAS, -2 * MASS * 9.80665 / GAP
KP, KI, KD, TD = 350.0, 1000.0, 10.0, 1e-3
RIG = f"""schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
axes = 1
[parameters]
mass = {MASS}
gap = {GAP}
clearance = 7e-3
bias_current = {BIAS}
coil_inductance = {INDUCTANCE}
coil_resistance = {RESISTANCE}
supply_voltage = 24.0
amplifier_gain = {1 / RESISTANCE}
amplifier_time_constant = {INDUCTANCE / RESISTANCE}
probe_gain = 1000.0
adc_bits = 0
dac_bits = 0
control_rate = {RATE}
[noise]
displacement = 4e-6
current = 1e-3
"""
CAMPAIGN = """schema = "maglev-campaign/1"
rig = "rig.toml"
[[recording]]
file = "steps.npz"
sample_rate = 2000.0
excitation = {{ kind = "none" }}
controller = {{ form = "pid", kp = 350.0, ki = 1000.0, kd = {kd}, td = 1e-3, derivative_on = "measurement" }}
[recording.channels]
displacement = {{ from = "y" }}
reference = {{ from = "r" }}
command = {{ from = "u" }}
current = {{ from = "i" }}
"""


@pytest.fixture(scope="module")
def run():
    return simulated()


def simulated(more=1.0, of_current=0.0):
    """Channels of ten seconds of set-point steps, under so many times the gains and with one of the read current."""
    rng, n, dt = np.random.default_rng(2), 20_000, 1 / RATE
    slopes = np.array([
        [0.0, 1.0, 0.0, 0.0],
        [-STIFFNESS / MASS, 0.0, GAIN / MASS, 0.0],
        [0.0, -GAIN / INDUCTANCE, -RESISTANCE / INDUCTANCE, RESISTANCE / INDUCTANCE],
        [0.0, 0.0, 0.0, 0.0],
    ])  # fmt: skip
    step = scipy.linalg.expm(slopes * dt)[:3]
    r = np.repeat(rng.uniform(-4e-4, 4e-4, 40), n // 40)
    r[: n // 40] = 0.0
    noise, found = rng.normal(size=(n, 2)) * (4e-6, 1e-3), np.empty((3, n))
    x, total, slope, before = np.zeros(3), 0.0, 0.0, 0.0
    for k in range(n):
        y = x[0] + noise[k, 0]
        total += KI * dt * (r[k] - y)
        slope = (TD * slope - KD * (y - before)) / (TD + dt)
        before = y
        read = x[2] + noise[k, 1]
        u = more * (KP * (r[k] - y) + slope + total) - of_current * read
        found[:, k] = y, u, read
        x = step @ [*x, u]
    return {"y": found[0], "r": r, "u": found[1], "i": found[2]}


def findings(folder, channels, kd=KD):
    (folder / "rig.toml").write_text(RIG)
    (folder / "campaign.toml").write_text(CAMPAIGN.format(kd=kd))
    np.savez(folder / "steps.npz", **channels)
    return [f for f in examine(load_campaign(folder)) if f.kind != "not checkable"]


def high_passed(values, corner):
    pole = np.exp(-2 * np.pi * corner / RATE)
    return values - scipy.signal.lfilter([1 - pole], [1.0, -pole], values)


def test_what_the_motion_induces_is_no_ac_coupling(run, tmp_path):
    assert not findings(tmp_path, run)


@pytest.mark.parametrize("corner", [1.0, 3.0])
def test_an_ac_coupled_current_is_named_beside_what_is_induced(corner, run, tmp_path):
    (found,) = findings(tmp_path, run | {"i": high_passed(run["i"], corner)})
    assert (found.code, found.channel) == ("filter", "current") and found.value == pytest.approx(corner, rel=0.3)


@pytest.mark.parametrize("corner", [0.0, 1.0])
@pytest.mark.parametrize("name", ["y", "u"])
def test_a_reversed_column_is_refused_whatever_the_current_looks_like(name, corner, run, tmp_path):
    current = high_passed(run["i"], corner) if corner else run["i"]
    found = findings(tmp_path, run | {name: -run[name], "i": current})
    wrong = {"y": "displacement", "u": "command"}[name]
    assert any(f.kind == "contradiction" and f.code == "sign" and wrong in f.channel for f in found)


@pytest.mark.parametrize("corner", [0.0, 1.0])
def test_a_wrong_gain_is_told_whatever_the_current_looks_like(corner, run, tmp_path):
    current = high_passed(run["i"], corner) if corner else run["i"]
    found = findings(tmp_path, run | {"i": current}, kd=KD / 2)
    assert any("gains" in f.channel and f.kind == "wiring" for f in found)


@pytest.mark.parametrize("turned", [1, -1])
def test_one_probe_of_two_that_is_reversed_is_named(turned, run, tmp_path):
    """The ball also rolls, which the sum of both probes hides from the controller."""
    rolls = np.cumsum(np.random.default_rng(5).normal(size=run["y"].size)) * 5e-6
    (tmp_path / "rig.toml").write_text(RIG)
    wanted = '{ from = ["left", "right"], weights = [0.5, 0.5] }'
    text = CAMPAIGN.format(kd=KD).replace('{ from = "y" }', wanted)
    (tmp_path / "campaign.toml").write_text(text)
    np.savez(tmp_path / "steps.npz", left=run["y"] + rolls, right=turned * (run["y"] - rolls), **run)
    found = [f for f in examine(load_campaign(tmp_path)) if f.kind != "not checkable"]
    assert [f.code for f in found] == ([] if turned > 0 else ["sign"])
    # Either sign of the whole reading is then a reading of the ball: which of both probes it is, one sign alone tells.
    assert turned > 0 or ("'right'" in found[0].message and found[0].kind == "contradiction")


def test_a_reversed_displacement_is_named_where_the_controller_reads_the_current_too(tmp_path):
    """The current's share of the command, which is right, had left only "not what the controller makes"."""
    own = (
        f'form = "state_feedback", displacement = {2 * KP}, velocity = {2 * KD}, integral = {2 * KI}, current = 1.0, '
        f"velocity_filter = {TD} }}"
    )
    text = CAMPAIGN.format(kd=KD)
    begin = text.index("form =")
    (tmp_path / "rig.toml").write_text(RIG)
    (tmp_path / "campaign.toml").write_text(text[:begin] + own + text[text.index("\n", begin) :])
    run = simulated(2.0, 1.0)
    for sign in (1, -1):
        np.savez(tmp_path / "steps.npz", **(run | {"y": sign * run["y"]}))
        named = {(f.code, f.channel) for f in examine(load_campaign(tmp_path)) if f.kind != "not checkable"}
        assert named == (set() if sign > 0 else {("sign", "displacement")})
