"""`maglev export`: what is read back from its files responds as the program's own loop and as the recording does."""

import runpy

import campaigns
import control
import numpy as np
import pytest
from command_line import check_json, maglev
from scipy.io import loadmat

from maglev_env import load_rig
from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import effect
from maglev_workbench.commands.export.files import write_python
from maglev_workbench.commands.export.models import Model, _measured, _name, rig_models

EFFECTS = effect("delay", 1.3e-4)
FIELD = {"plant": "plant", "controller": "controller", "closed": "receptance"}


def wanted(rig, frequency):
    """The program's own responses of a rig with a delay."""
    return loop_response(Experiment(rig, rig.gains, (), effects=EFFECTS), frequency)


def complex_(data):
    return np.asarray(data, float) @ [1, 1j]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The same models of hmb_free with a delay in all three formats."""
    folder = tmp_path_factory.mktemp("export")
    for ending in ("mat", "json", "py"):
        maglev("export", "hmb_free", "--effect", "delay=1.3e-4", "--out", folder / f"m.{ending}")
    return folder


def test_matlab_reads_structs_for_ss_tf_and_frd(files):
    found = loadmat(files / "m.mat", simplify_cells=True)
    assert "SI units" in found["about"] and "negative" in found["about"] and "delay" in found["plant"]["about"]
    for name, field in FIELD.items():
        one = loadmat(files / "m.mat", squeeze_me=False)[name][0, 0]
        a, b, c, d = (one[key] for key in "ABCD")
        assert a.shape == (len(a), len(a)) and b.shape == (len(a), 1) and c.shape == (1, len(a)) and d.shape == (1, 1)
        frequency = one["frequency_Hz"].ravel()
        response = getattr(wanted(load_rig("hmb_free"), frequency), field)
        system = control.ss(a, b, c, d, float(one["Ts"][0, 0]))
        z = np.exp(2j * np.pi * frequency * system.dt)
        np.testing.assert_allclose(system(z), response, rtol=1e-6)
        np.testing.assert_allclose(one["response"].ravel(), response, rtol=1e-6)
        # Far below the control rate the coefficients lose digits, as the file says.
        ratio = control.tf(one["num"].ravel(), one["den"].ravel(), system.dt)(z)
        np.testing.assert_allclose(ratio[frequency > 10], response[frequency > 10], rtol=1e-3)
    assert (found["plant"]["input"], found["plant"]["input_unit"]) == ("command", "A")
    assert (found["plant"]["output"], found["plant"]["output_unit"]) == ("displacement", "m")


def test_json_has_the_same_and_states_its_conventions(files):
    data = check_json(files / "m.json")
    assert any("SI units" in line for line in data["conventions"])
    assert {one["name"] for one in data["models"]} == FIELD.keys()
    for one in data["models"]:
        response = getattr(wanted(load_rig("hmb_free"), np.array(one["frequency"])), FIELD[one["name"]])
        np.testing.assert_allclose(complex_(one["response"]), response, rtol=1e-6)
        assert one["sample_time"] == 1 / 20000 and one["variance"] is None


def test_the_python_file_runs_and_its_loop_closes_as_the_program_says(files):
    made = runpy.run_path(str(files / "m.py"))
    loop = control.feedback(made["plant"], made["controller"])
    assert np.abs(loop.poles()).max() == pytest.approx(np.abs(made["closed"].poles()).max(), rel=1e-6) and loop.dt
    assert "# All numbers are in SI units" in (files / "m.py").read_text()


def test_two_axes_have_matrices_and_no_polynomials(tmp_path):
    rig = load_rig("hmb_radial")
    for one in rig_models(rig, EFFECTS):
        assert one.transfer_function is None and one.state_space[3].shape == (2, 2)
        assert one.response.shape == (one.frequency.size, 2, 2)
    maglev("export", "hmb_radial", "--effect", "delay=1.3e-4", "--out", tmp_path / "m.mat")
    found = loadmat(tmp_path / "m.mat", simplify_cells=True)["closed"]
    receptance = np.moveaxis(wanted(rig, found["frequency_Hz"]).receptance, 0, -1)
    np.testing.assert_allclose(found["response"], receptance, rtol=1e-6, atol=1e-9 * np.abs(receptance).max())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """One recording of hmb_free with the delay."""
    return campaigns.campaign(tmp_path_factory.mktemp("rig"), effects=EFFECTS, names=("base",))


@pytest.mark.slow
def test_recordings_give_what_was_measured(recorded, tmp_path):
    maglev("export", recorded, "--out", tmp_path / "m.json")
    models = {one["name"]: one for one in check_json(tmp_path / "m.json")["models"]}
    one = models["base_receptance"]
    rig, s = load_rig("hmb_free"), 2j * np.pi * np.array(one["frequency"])
    hold = -np.expm1(-s / rig.control_rate) / (s / rig.control_rate)
    truth = wanted(rig, np.array(one["frequency"])).receptance * (1 + s * rig.sensor_time_constant) / hold
    # Noise and the force law's curvature alone may stand between the recording and the linear loop of its own rig.
    np.testing.assert_allclose(complex_(one["response"]), truth, rtol=0.02)
    assert (np.array(one["variance"]) > 0).all() and one["sample_time"] is None
    loop = models["base_loop_gain"]
    off = complex_(loop["response"]) - wanted(rig, np.array(loop["frequency"])).loop_gain
    assert 0.2 < np.mean(np.abs(off) ** 2 / loop["variance"]) < 4  # it is off by as much as it says
    maglev("export", recorded, "--out", tmp_path / "m.py")
    made = runpy.run_path(str(tmp_path / "m.py"))
    data = made["base_loop_gain"]
    np.testing.assert_array_equal(data(1j * data.omega), complex_(loop["response"]))
    np.testing.assert_allclose(data.omega, 2 * np.pi * np.array(loop["frequency"]))
    assert 1 < 1 / control.stability_margins(data)[2] < 5  # the peak of |S| is that of a loop that works
    if mode := models.get("base_mode"):
        np.testing.assert_allclose(made["base_mode"](s), 1 / np.polyval(mode["denominator"], s))


def test_a_name_of_a_file_is_never_run(tmp_path):
    evil = 'a"""\nraise SystemExit\n.npz'
    one = Model("m", evil, ("force", "N", "displacement", "m"), None, np.ones(2), np.ones(2) + 1j)
    write_python(tmp_path / "m.py", evil, [one])
    assert "m" in runpy.run_path(str(tmp_path / "m.py"))


def test_recordings_of_one_name_are_told_apart():
    taken = set()
    names = [_name(file, taken) for file in ("run.mat", "run.csv", "7.mat", "a/run.mat, x", "läuft.csv")]
    assert names == ["run", "run_2", "record_7", "a_run_x", "l_uft"]


def test_a_variance_that_is_not_known_is_left_out():
    line = np.array([1.0, 2.0, 3.0])
    signals = ("force", "N", "displacement", "m")
    one = _measured("m", "", signals, line, np.array([1.0, np.nan, 2.0j]), np.array([1.0, 1.0, np.nan]))
    assert one.variance is None and list(one.frequency) == [1.0, 3.0] and list(one.response) == [1.0, 2.0j]


def test_what_cannot_be_exported_is_refused(recorded, tmp_path):
    assert "--effect goes with a rig" in maglev("export", recorded, "--effect", "delay=1e-4", code=2)
    assert "use one of .mat, .json, .py" in maglev("export", "hmb_free", "--out", tmp_path / "m.txt", code=2)
