"""Every name stands in one registry, and whatever a name needs is there: what is missing fails here by its name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from maglev_env.channels import CHANNELS, NOISY, RECORDED, simulated_channels, step_channels
from maglev_env.loop.gains import of_axis
from maglev_env.loop.magnets.kinds import KINDS, check_magnet, force_law, inductance
from maglev_env.loop.magnets.law import force, linearise
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import read_recording
from maglev_env.rig.excitation import PLACES
from maglev_env.rig.rig import Noise, Rig
from maglev_env.rig.rig_file import PRESETS, ROTORS, load_rig
from maglev_env.rotor.rotor import load_rotor
from maglev_env.task.task import make_task
from maglev_workbench.cli import app
from tuning.methods import METHODS, make_tuner

ROOT = Path(__file__).parents[2]
FORMATS = (ROOT / "docs" / "formats.md").read_text()
# One working magnet of each kind.
MAGNETS = {
    "hybrid_pair": load_rig("hmb_free"),
    "electromagnet_pair": load_rig("eframe"),
    "electromagnet": Rig("ball", "electromagnet", mass=0.058, gap=10e-3, turns=1000, pole_area=3e-4),
    "magnet_coil": Rig("coil", "magnet_coil", mass=0.02, gap=15e-3, force_constant=2e-8, force_exponent=4.0,
                       coil_inductance=0.02),
}  # fmt: skip


@pytest.mark.parametrize("ending", ["", "_x"])
@pytest.mark.parametrize("name", RECORDED)
def test_a_channel_is_written_and_read_back(name, ending, tmp_path):
    values = 1e-5 * np.random.default_rng(3).standard_normal(64)
    variables = {
        channel + ending: ("time", values, {"units": CHANNELS[channel].unit})
        for channel in dict.fromkeys(("displacement", name))
    }
    made = xr.Dataset(variables, {"time": np.arange(64) / 1e3}, {"sample_rate": 1e3})
    write_campaign(tmp_path, "hmb_free", {}, [("one", "fit", made, None)])
    campaign = load_campaign(tmp_path)
    back = read_recording(campaign, campaign.recordings[0])
    np.testing.assert_array_equal(back[name + ending].values, values)
    assert back[name + ending].attrs["units"] == CHANNELS[name].unit


def test_channels_are_documented_as_the_table_has_them():
    rows = [f"  | `{name}` | {CHANNELS[name].unit} | {CHANNELS[name].meaning} |" for name in RECORDED]
    assert "\n".join(rows) in FORMATS
    assert set(CHANNELS) - set(RECORDED) <= set(simulated_channels(sensed=True)), "a channel that nothing makes"


def test_roles_of_channels_fit_what_uses_them():
    assert set(NOISY) == vars(Noise()).keys()
    assert PLACES == ("force", "current", "reference")  # the order in which kernels take the waves
    assert NOISY == ("displacement", "current", "force")  # the order of the noise streams
    assert step_channels(sensed=True)[-1] == step_channels()[-1] == "current"  # which the step writes last


@pytest.mark.parametrize("kind", KINDS)
def test_a_magnet_has_all_that_a_rig_needs_of_it(kind):
    rig = MAGNETS[kind]
    check_magnet(rig)
    law, step = force_law(rig), 1e-7 * rig.gap
    gain, stiffness = linearise(law)
    bias = abs(law.bias_current) or 1.0
    assert force(law, 0.0, 1e-6 * bias) - force(law, 0.0, 0.0) == pytest.approx(gain * 1e-6 * bias, rel=1e-4)
    assert force(law, 0.0, 0.0) - force(law, step, 0.0) == pytest.approx(stiffness * step, rel=1e-4)
    assert inductance(rig) > 0
    assert ("pair" in rig.capabilities) == KINDS[kind].pair == (KINDS[kind].balancing_bias is None)
    assert f"| `{kind}` |" in FORMATS
    for name in KINDS[kind].own:
        with pytest.raises(ValueError, match=name):
            replace(rig, **{name: None})


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_named_by_its_file(name):
    assert load_rig(name).name == name
    assert f"`{name}`" in (ROOT / "README.md").read_text()


@pytest.mark.parametrize("name", ROTORS)
def test_a_rotor_is_named_by_its_file(name):
    assert load_rotor(name).name == name


@pytest.mark.parametrize("name", METHODS)
def test_a_tuner_asks_in_the_box_and_as_its_entry_says(name):
    task = make_task(protocol="quick", randomization="wide")
    episode = task.draw(np.random.default_rng(1))
    asked, again = (make_tuner(name, task, episode, 5, 27).ask(4) for _ in range(2))
    assert asked.ndim == 2 and 1 <= len(asked) <= 4 and asked.shape[1] == len(task.box.names)
    assert (abs(asked) <= 1).all()
    np.testing.assert_array_equal(asked, again)
    assert METHODS[name].safe_start == np.allclose(asked[0], episode.start)
    assert METHODS[name].about
    if METHODS[name].near:
        near = make_tuner(f"{name}@preset", task, episode, 5, 27).ask(1)[0]
        np.testing.assert_allclose(near, task.box.point(of_axis(task.rig.gains, 0)), atol=1e-9)


def test_help_names_every_tuner_and_preset():
    shown = " ".join(CliRunner().invoke(app, ["tune", "--help"], env={"COLUMNS": "200"}).output.split())
    assert all(name in shown for name in (*METHODS, *PRESETS))
