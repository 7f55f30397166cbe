"""AC coupling: the corner is recovered with its error and its channel, and noise has none."""

import re

import bench_loop
import campaigns
import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.loop.gains import controller_output
from maglev_env.recordings.campaign import load_campaign
from maglev_env.redundancy.coupling import _corner
from maglev_env.redundancy.relation import Relation
from maglev_env.redundancy.rows import LEVEL
from maglev_env.redundancy.rules import examine

F = np.linspace(2, 300, 80)
SD = 0.01


def relation(rng, behind="", corner=3.0):
    """A command that displacement and injection make, each with noise, one of them behind a high-pass."""
    high = {name: 1j * F / (1j * F + corner) if name == behind else 1.0 for name in ("command", "a", "b")}
    a, b = (np.exp(2j * np.pi * rng.random(F.size)) for _ in range(2))
    b = b * F / 100
    out = (a + b) * high["command"] + SD * (rng.normal(size=F.size) + 1j * rng.normal(size=F.size)) / np.sqrt(2)
    return Relation("command", out, {"a": a * high["a"], "b": b * high["b"]}, np.full(F.size, SD**2), "what it makes")


@pytest.mark.parametrize("behind", ["command", "a", "b"])
def test_the_corner_and_its_channel_are_recovered(behind):
    rng = np.random.default_rng(1)
    for _ in range(20):
        corner, se, name = _corner(F, relation(rng, behind))
        assert name == behind and abs(corner - 3.0) < 5 * se + 0.05


@pytest.mark.parametrize("scale", [0.5, 2.0, -1.0])
@pytest.mark.parametrize("behind", ["command", "a", "b"])
def test_a_wrong_scale_or_sign_beside_it_moves_no_corner(behind, scale):
    rng = np.random.default_rng(4)
    one = relation(rng, behind)
    for changed in ("command", "a", "b"):
        size = {name: scale if name == changed else 1.0 for name in ("command", "a", "b")}
        made = {name: size[name] * values for name, values in one.made.items()}
        out, variance = size["command"] * one.out, size["command"] ** 2 * one.variance
        corner, se, name = _corner(F, Relation("command", out, made, variance, ""))
        assert name == behind and abs(corner - 3.0) < 5 * se + 0.05


def test_noise_gains_and_delays_have_no_corner():
    rng = np.random.default_rng(2)
    for _ in range(300):
        one = relation(rng)
        late = {"a": 1.3 * one.made["a"] * np.exp(-2j * np.pi * F * 1e-4), "b": 0.8 * one.made["b"]}
        for made in (one.made, late):
            corner, se, name = _corner(F, Relation("command", one.out, made, one.variance, ""))
            assert not name or corner < max(LEVEL * se, 0.1)


def test_an_ac_coupled_column_of_a_recording_is_named(tmp_path):
    folder = campaigns.campaign(tmp_path, names=("base",))
    sound, pole = dict(np.load(folder / "base.npz")), np.exp(-2 * np.pi * 2.0 / 20000)
    for name, code in (("displacement", "filter"), ("command", "filter"), ("force", "shape")):
        filtered = sound[name] - lfilter([1 - pole], [1, -pole], sound[name])
        np.savez(folder / "base.npz", **(sound | {name: filtered}))
        found = next(f for f in examine(load_campaign(folder)) if f.code == code)
        assert found.channel == name and found.value == pytest.approx(2.0, rel=0.1) and repr(name) in found.message


@pytest.mark.parametrize("factor", [10.0, 30.0])
def test_an_integral_gain_that_is_too_large_is_no_ac_coupled_command(tmp_path, factor):
    folder = campaigns.campaign(tmp_path, names=("base",))
    text = (folder / "campaign.toml").read_text()
    (stated,) = set(re.findall(r"ki = ([0-9.e+]+)", text))
    (folder / "campaign.toml").write_text(text.replace(f"ki = {stated}", f"ki = {factor * float(stated)}"))
    (said,) = [f for f in examine(load_campaign(folder)) if f.code == "filter"]
    assert said.channel == "gains" and said.interval[0] < float(stated) < said.interval[1]
    assert "the integral gain, is" in said.message


@pytest.mark.parametrize("gain", ["kp", "kd"])
def test_a_proportional_or_derivative_gain_that_is_wrong_is_not_taken_for_the_integral_one(tmp_path, gain):
    folder = campaigns.campaign(tmp_path, names=("base",))
    text = (folder / "campaign.toml").read_text()
    (stated,) = set(re.findall(rf"{gain} = ([0-9.e+]+)", text))
    (folder / "campaign.toml").write_text(text.replace(f"{gain} = {stated}", f"{gain} = {1.12 * float(stated)}"))
    for said in (f for f in examine(load_campaign(folder)) if f.code == "filter"):
        assert f"with {gain} = " in said.message and said.message.endswith(f"correct {gain}")
        assert said.interval[0] < float(stated) < said.interval[1]


def test_the_time_constant_of_the_derivative_is_named_and_no_other_gain(tmp_path):
    """It had been a derivative gain with a displacement that is read early, and a rig under both was worse."""
    folder = campaigns.campaign(tmp_path, names=("base",))
    text = (folder / "campaign.toml").read_text()
    (stated,) = set(re.findall(r"td = ([0-9.e+-]+)", text))
    (folder / "campaign.toml").write_text(text.replace(f"td = {stated}", f"td = {6 * float(stated)}"))
    found = [f for f in examine(load_campaign(folder)) if f.kind in ("contradiction", "wiring", "effect")]
    assert len(found) == 1 and "with td = " in found[0].message and found[0].message.endswith("correct td")
    assert found[0].interval[0] < float(stated) < found[0].interval[1]


def test_a_wrong_scale_beside_an_ac_coupled_column_is_named_too(tmp_path):
    """The corner was wrong by the scale's factor, and what was made of the channel without it hid the scale."""
    folder = campaigns.campaign(tmp_path, names=("base",))
    sound, pole = dict(np.load(folder / "base.npz")), np.exp(-2 * np.pi * 2.0 / 20000)
    filtered = sound["displacement"] - lfilter([1 - pole], [1, -pole], sound["displacement"])
    for scale in (0.5, -1.0):
        np.savez(folder / "base.npz", **(sound | {"displacement": scale * filtered}))
        found = examine(load_campaign(folder))
        coupling = next(f for f in found if f.code == "filter")
        assert coupling.channel == "displacement" and coupling.value == pytest.approx(2.0, rel=0.1)
        assert any(f.code == ("sign" if scale < 0 else "scale") and f.channel == "displacement" for f in found)


def test_slow_parts_that_a_record_without_a_period_lacks_are_told(tmp_path):
    """Of a whole record, and of one that begins in the middle of a run."""
    bench = bench_loop.Bench(noise=0.5e-6)
    bench_loop.write_campaign(tmp_path, bench, {"steps": "fit"}, 1.5, 4)
    _, reference = bench_loop.excitation("steps", 1.5, np.random.default_rng(4))
    run = bench_loop.record(bench, "steps", 1.5, 4) | {"reference": reference}
    text = (tmp_path / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(f'{text.rstrip()}\nreference = {{ from = "reference" }}\n')
    pole = np.exp(-2 * np.pi * 1.0 / bench_loop.RATE)
    for begin in (0, 7000):
        sound = {name: run[name][begin:] for name in ("displacement", "command", "current", "reference")}
        np.savez(tmp_path / "steps.npz", **sound)
        assert not any(f.code == "filter" for f in examine(load_campaign(tmp_path)))
        filtered = sound["displacement"] - lfilter([1 - pole], [1, -pole], sound["displacement"])
        np.savez(tmp_path / "steps.npz", **(sound | {"displacement": filtered}))
        found = examine(load_campaign(tmp_path))
        assert any(f.code == "filter" and "slow parts" in f.message for f in found)


def test_a_rotor_whose_mean_moves_is_neither_ac_coupled_nor_under_another_gain(tmp_path):
    """A ramp steps back at the end of each period, and its lines are no response."""
    folder = campaigns.campaign(tmp_path, names=("base",))
    sound, (recording,) = dict(np.load(folder / "base.npz")), load_campaign(folder).recordings
    ramp = 1e-5 * np.arange(sound["displacement"].size) / 20000
    made = controller_output(recording.gains, dt=1 / 20000, displacement=ramp)
    moved = {"displacement": ramp, "command": made, "current": made}
    np.savez(folder / "base.npz", **(sound | {name: sound[name] + change for name, change in moved.items()}))
    assert not any(f.code == "filter" for f in examine(load_campaign(folder)))
