"""The notebooks run, and say what their text says."""

import runpy
from pathlib import Path

import numpy as np
import pytest

NOTEBOOKS = Path(__file__).parents[2] / "examples" / "notebooks"


def run(name):
    return runpy.run_path(str(NOTEBOOKS / f"{name}.py"))


@pytest.mark.slow
def test_a_delay_takes_damping_and_margin_and_leaves_the_stiffness():
    table = run("bearing_engineer")["table"]
    assert (table["damping late"] < table["damping"]).all()
    assert (table["peak_sensitivity late"] > table["peak_sensitivity"]).all()
    np.testing.assert_allclose(table["stiffness late"], table["stiffness"], rtol=0.1)
    assert (table["stiffness_low"] < table["stiffness_high"]).all()


@pytest.mark.slow
def test_the_measured_loop_has_the_margins_of_the_model():
    made = run("control_engineer")
    unstable = np.abs(made["plant"].poles()) > 1
    assert unstable.sum() == 1 and np.abs(made["closed"].poles()).max() < 1
    np.testing.assert_allclose(made["margins"]["measured"][1], made["margins"]["modelled"][1], atol=1.0)  # deg


@pytest.mark.slow
def test_every_rig_has_a_best_score():
    made = run("rl_researcher")
    assert made["anywhere"].shape == made["nearby"].shape == (16,)
    assert np.isfinite(made["anywhere"]).all() and made["anywhere"].mean() > 0
