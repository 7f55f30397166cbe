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


BEFORE_IMPORTS = {  # what is asked for -> the extra that it needs, known before the imports that take long
    "tune --method gp --budget 2": "rl",
    "tune --method tpe --budget 2": "search",
    "tune --method cma-es --budget 2": "search",
}
BEFORE_WORK = {  # known before any work
    "tune --method learned --budget 2": "rl",  # whether it needs one depends on the rig, which must be read first
    "runup --picture p.png": "",
    "compare model tpe": "",
    "tune --goal engineer --reference h-infinity": "",
}


def test_a_command_that_needs_an_extra_says_how_to_install_it_before_any_work(tmp_path):
    """One after the other in a process of their own, as the packages of the extras are gone there."""
    out, calls = tmp_path / "t", BEFORE_IMPORTS | BEFORE_WORK
    done = run(
        f"for call in {list(calls)!r}:\n"
        "    try:\n"
        f"        app([*call.split(), '--out', {str(out)!r}])\n"
        "    except SystemExit as end:\n"
        "        print(end.code, 'scipy' in sys.modules)\n"
    )
    told, said = done.stdout.splitlines(), done.stderr.splitlines()
    assert len(told) == len(said) == len(calls), done.stdout + done.stderr
    assert told[: len(BEFORE_IMPORTS)] == ["2 False"] * len(BEFORE_IMPORTS)
    assert {line.split()[0] for line in told} == {"2"}
    for line, (call, extra) in zip(said, calls.items(), strict=True):
        assert f"pip install 'maglev-workbench[{extra}" in line, call
    assert not out.exists()


def test_a_plot_without_matplotlib_says_how_to_install_it():
    done = run("import maglev_env.presented\nmaglev_env.presented.matplotlib_figure()\n")
    assert 'pip install "maglev-workbench[plot]"' in done.stderr
