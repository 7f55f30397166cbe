"""What works without the packages of the extras, and what says that it needs them."""

import subprocess
import sys

import pytest

WITHOUT = """
import sys
GONE = ("cmaes", "filterpy", "matplotlib", "optuna", "slycot", "stable_baselines3", "torch")
class Missing:
    def find_spec(self, name, path=None, target=None):
        if (top := name.split(".")[0]) in GONE:
            raise ModuleNotFoundError(f"No module named {top!r}", name=top)
sys.meta_path.insert(0, Missing())
from maglev_workbench.cli import app
"""


def run(code):
    return subprocess.run([sys.executable, "-c", WITHOUT + code], capture_output=True, text=True, timeout=300)


@pytest.mark.slow
def test_the_environments_the_sweep_and_the_default_tuner_need_no_extra(tmp_path):
    swept, tuned = str(tmp_path / "swept"), str(tmp_path / "tuned")
    done = run(
        "import gymnasium, maglev_env\n"
        "env = gymnasium.make('maglev/HMBFree-v0')\n"
        "env.reset(seed=0); env.step(env.action_space.sample())\n"
        f"app(['sweep', '--sobol', '4', '--out', {swept!r}], standalone_mode=False)\n"
        f"app(['tune', '--budget', '2', '--protocol', 'quick', '--out', {tuned!r}], standalone_mode=False)\n"
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "swept" / "sweep.nc").exists()


@pytest.mark.parametrize(
    ("method", "extra"), [("learned", "rl"), ("gp", "rl"), ("tpe", "search"), ("cma-es", "search")]
)
def test_a_tuner_that_needs_an_extra_says_how_to_install_it_before_any_work(method, extra, tmp_path):
    out = tmp_path / "t"
    asked = f"['tune', '--method', {method!r}, '--budget', '2', '--out', {str(out)!r}]"
    done = run(f"try: app({asked})\nfinally: print('scipy' in sys.modules)\n")
    assert done.returncode == 2
    if method != "learned":  # whether that needs one depends on the rig, which must be read first
        assert done.stdout.split() == ["False"]  # before the imports that take long
    assert f"pip install 'maglev-workbench[{extra}]'" in done.stderr
    assert not out.exists()


@pytest.mark.parametrize(
    "command",
    [
        ["runup", "--picture", "p.png"],
        ["compare", "model", "tpe"],
        ["tune", "--goal", "engineer", "--reference", "h-infinity"],
    ],
)
def test_a_command_that_needs_an_extra_says_so_before_any_work(command, tmp_path):
    out = tmp_path / "t"
    done = run(f"app([*{command!r}, '--out', {str(out)!r}])\n")
    assert done.returncode == 2 and "pip install 'maglev-workbench[" in done.stderr
    assert not out.exists()


def test_a_plot_without_matplotlib_says_how_to_install_it():
    done = run("import maglev_env.presented\nmaglev_env.presented.matplotlib_figure()\n")
    assert 'pip install "maglev-workbench[plot]"' in done.stderr
