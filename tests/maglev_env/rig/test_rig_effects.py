"""Effects that a rig has of its own: read, refused, and the same in every experiment as effects given beside it."""

import re
from dataclasses import replace
from importlib import resources
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import maglev_env  # noqa: F401  (registers the environments)
from maglev_env.experiment import Experiment, axis_experiment, protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.effect import EFFECTS, effect
from maglev_env.recordings.campaign import load_campaign
from maglev_env.rig.rig import axis_rig, with_parameters
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from tuning.axis import Axis
from tuning.sweep import Sweep
from tuning.sweep_run import run_sweep

OWN = "\n[effects.delay]\ntime = 7.5e-5\n\n[effects.eddy_current]\ncorner_hz = 900.0\n"
DELAY, EDDY = effect("delay", 7.5e-5), effect("eddy_current", 900.0)
CROSSED = effect("cross_coupling", 0.1)
DOCS = Path(__file__).parents[3] / "docs" / "formats.md"


def text_of(preset):
    return (resources.files("maglev_env") / "rigs" / f"{preset}.toml").read_text()


def with_effects(preset="hmb_free", effects=OWN):
    return rig_from_toml(text_of(preset) + effects, "here")


def short(e):
    """One period of 4 Hz lines, for the simulator."""
    parts = tuple(replace(x, fundamental=4.0, lines=tuple(n for n in x.lines if n < 200)) for x in e.excitations)
    return replace(e, excitations=parts, periods=1, transient_periods=0)


def test_a_table_is_read_with_its_defaults():
    rig = with_effects()
    assert rig.effects == {**DELAY, **EDDY} and rig.effects["eddy_current"]["order"] == 0.5
    assert load_rig("hmb_free").effects == {} and replace(rig, effects={}) == load_rig("hmb_free")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[effects.dely]\ntime = 1e-5", r"\[effects\]: unknown key 'dely'"),
        ("[effects.delay]\nduration = 1e-5", r"\[effects.delay\]: unknown key 'duration'; known keys: time"),
        ("[effects]\ndelay = 1e-5", r"\[effects\]: delay = 1e-05 must be a table: \[effects.delay\] with time"),
        ("[effects.delay]", r"\[effects.delay\]: .*give time"),
        ("[effects.delay]\ntime = 0.05", r"delay.time = 0.05 is outside 0 .. 0.001 s on rig hmb_free"),
        ("[effects.delay]\ntime = nan", r"delay.time = nan is outside"),
        ("[effects.delay]\ntime = 'late'", r"\[effects.delay\]: time = 'late' is not a number"),
        ("[effects.delay]\ntime = true", r"time = True is not a number"),
        ("[effects.delay]\nname = 1.0", r"unknown key 'name'"),
        ("[effects.cross_coupling]\nratio = 0.1", r"cross_coupling has no meaning on rig hmb_free: it needs two axes"),
        ("[effects.support_stiffness]\nchange = 0.1", r"it needs a support_stiffness"),
    ],
)
def test_bad_effects_are_refused_with_their_key(text, said):
    with pytest.raises(ValueError, match=f"here: .*{said}"):
        with_effects(effects="\n" + text)


def test_an_experiment_has_the_rigs_effects_and_its_own_override_them():
    e = protocol_experiment(with_effects())
    assert e.effects == {**DELAY, **EDDY}
    later = replace(e, effects=effect("delay", 2e-5))
    assert later.effects == {**effect("delay", 2e-5), **EDDY}
    assert replace(e, seed=3).effects == e.effects and replace(later, periods=2).effects == later.effects
    assert replace(e, effects={}).effects == e.effects  # the rig's own stay
    assert replace(e, rig=with_parameters(e.rig, {"mass": 0.09})).effects == e.effects
    nominal = protocol_experiment(load_rig("hmb_free"), effects=effect("mass", 0.1))
    assert replace(nominal, rig=e.rig).effects == {**DELAY, **EDDY, **effect("mass", 0.1)}


def test_the_linear_loop_is_that_of_the_same_effects_given_beside_the_rig():
    own = protocol_experiment(with_effects())
    beside = protocol_experiment(load_rig("hmb_free"), effects={**DELAY, **EDDY})
    nominal = protocol_experiment(load_rig("hmb_free"))
    f = np.geomspace(5.0, 2000.0, 40)
    np.testing.assert_array_equal(closed_loop_poles(own), closed_loop_poles(beside))
    np.testing.assert_array_equal(loop_response(own, f).sensitivity, loop_response(beside, f).sensitivity)
    assert abs(loop_response(own, f).sensitivity - loop_response(nominal, f).sensitivity).max() > 0.05


@pytest.mark.slow
def test_the_simulation_is_that_of_the_same_effects_given_beside_the_rig():
    free = load_rig("hmb_free")
    effects = {**DELAY, **effect("friction", 0.02)}
    rows = [short(protocol_experiment(replace(free, effects=effects)))]
    rows += [short(protocol_experiment(free, effects=given)) for given in (effects, {})]
    own, beside, nominal = simulate_records(rows)
    np.testing.assert_array_equal(own, beside)
    assert abs(own[0] - nominal[0]).max() > 1e-7


def test_two_axes_share_the_rigs_effects_and_each_has_those_of_one():
    rig = with_effects("hmb_radial", OWN + "\n[effects.cross_coupling]\nratio = 0.1\n")
    e = protocol_experiment(rig)
    assert e.effects == {**DELAY, **EDDY, **CROSSED}
    for axis in range(2):
        assert axis_rig(rig, axis).effects == {**DELAY, **EDDY}
        alone = axis_experiment(e, axis)
        assert alone.effects == {**DELAY, **EDDY} and alone.rig.axes == 1
        given = axis_experiment(protocol_experiment(load_rig("hmb_radial"), effects={**DELAY, **EDDY}), axis)
        np.testing.assert_array_equal(closed_loop_poles(alone), closed_loop_poles(given))
    beside = protocol_experiment(load_rig("hmb_radial"), effects=e.effects)
    np.testing.assert_array_equal(closed_loop_poles(e), closed_loop_poles(beside))


def test_a_probes_effect_of_the_rig_is_refused_with_self_sensing():
    rig = replace(load_rig("hmb_free"), effects=effect("sensor_gain", 0.1))
    with pytest.raises(ValueError, match="sensor_gain"):
        protocol_experiment(rig, sensor="self_sensing")


@pytest.mark.slow
def test_an_environment_on_the_file_is_that_with_the_effects_given(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(text_of("hmb_free") + OWN)
    own = gym.make("maglev/Rig-v0", rig=path, protocol="quick")
    beside = gym.make("maglev/Rig-v0", rig="hmb_free", protocol="quick", effects={**DELAY, **EDDY})
    action = np.zeros(own.action_space.shape, own.action_space.dtype)
    found = []
    for env in (own, beside):
        env.reset(seed=4)
        found.append(env.step(action)[4])
    assert found[0]["band_stiffness"] == pytest.approx(found[1]["band_stiffness"], rel=1e-12)
    assert found[0]["peak_sensitivity"] == found[1]["peak_sensitivity"]


@pytest.mark.slow
def test_a_sweep_of_the_rig_is_that_with_the_effects_given(tmp_path):
    axes = {"kp": Axis(8000.0, 8000.0, 1)}
    target = replace(load_rig("hmb_free").target, stiffness=35e3, damping=30.0)
    free = replace(load_rig("hmb_free"), target=target)
    own = run_sweep(Sweep(replace(free, effects={**DELAY, **EDDY}), axes), tmp_path / "own")
    beside = run_sweep(Sweep(free, axes, effects={**DELAY, **EDDY}), tmp_path / "beside")
    nominal = run_sweep(Sweep(free, axes), tmp_path / "nominal")
    assert own.score.values == beside.score.values != nominal.score.values


def test_a_campaign_may_name_a_rig_with_effects(tmp_path):
    (tmp_path / "rig.toml").write_text(text_of("hmb_free") + OWN)
    (tmp_path / "a.csv").write_text("y\n0\n")
    (tmp_path / "campaign.toml").write_text(
        'schema = "maglev-campaign/1"\nrig = "rig.toml"\n[[recording]]\nfile = "a.csv"\nsample_rate = 20000.0\n'
        'excitation = { kind = "none" }\n[recording.channels]\ndisplacement = { from = "y" }\n'
    )
    rig = load_campaign(tmp_path).rig
    assert Experiment(rig, rig.gains, ()).effects == {**DELAY, **EDDY}


def test_the_table_of_effects_in_the_docs_is_the_vocabulary():
    """Every effect, in order, with each parameter's unit, bounds and default."""
    rows = re.findall(r"^\| `(\w+)` \| (\w+) \| (.*?) \| ", DOCS.read_text(), re.M)
    assert [name for name, *_ in rows] == list(EFFECTS)
    for name, block, parameters in rows:
        kind = EFFECTS[name]
        if name.startswith("free_"):  # dozens of coefficients: each row says how they are called
            assert block == kind.block and (name == "free_current" or "`range`" in parameters)
            continue
        stated = [
            ", ".join(
                f"`{key}` {p.bounds}" + ("" if p.default is None else f" ({p.default:g})") for key, p in group.items()
            )
            for group in ({key: p for key, p in kind.parameters.items() if p.shape is None}, kind.shapes)
            if group
        ]
        assert (block, parameters) == (kind.block, "; form: ".join(stated))
