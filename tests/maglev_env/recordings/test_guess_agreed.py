"""Files of one rig: what one file cannot tell of a column, another one with the same column may."""

import numpy as np

from maglev_env.recordings.guess.agreed import agreed
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.guess.verified import verified


def stored(folder, name, positions, current):
    t = np.arange(positions.size) / 1000.0
    np.savez(folder / name, t=t, pos=positions, i=current)
    return verified(guess_recording(folder / name), folder)


def test_a_quiet_file_takes_the_unit_that_a_moving_one_shows(tmp_path):
    rng = np.random.default_rng(1)
    quiet = stored(tmp_path, "a.npz", 3.0 * rng.normal(size=4000), rng.normal(size=4000))  # um, but like mm
    moving = stored(tmp_path, "b.npz", 90.0 * rng.normal(size=4000), rng.normal(size=4000))
    assert (quiet.channels["displacement"].scale, moving.channels["displacement"].scale) == (1e-3, 1e-6)
    found = [g.channels["displacement"] for g in agreed([quiet, moving])]
    assert [c.scale for c in found] == [1e-6, 1e-6]
    assert "the larger values of b.npz" in found[0].reason and "unit of this column" in found[0].ask


def test_a_direction_that_one_file_shows_holds_for_all(tmp_path):
    rng = np.random.default_rng(2)
    steps = np.repeat(rng.uniform(-1e-3, 1e-3, 16), 250)
    moving = stored(tmp_path, "steps.npz", 6e-3 + steps, 1.0 + 100 * steps + 1e-3 * rng.normal(size=4000))
    hover = stored(tmp_path, "hover.npz", 6e-3 + 1e-6 * rng.normal(size=4000), 1.0 + 1e-3 * rng.normal(size=4000))
    assert (moving.channels["displacement"].scale, hover.channels["displacement"].scale) == (-1.0, 1.0)
    found = agreed([hover, moving])
    assert [g.channels["displacement"].scale for g in found] == [-1.0, -1.0]
    assert "as steps.npz shows" in found[0].channels["displacement"].reason
    assert "offset = the gap" in found[0].channels["displacement"].ask


def test_a_controller_counts_in_the_direction_of_its_displacement(tmp_path):
    rng = np.random.default_rng(3)
    gap = 6e-3 + 1e-3 * np.cumsum(rng.normal(size=4000)) / 60
    t = np.arange(gap.size) / 1000.0
    np.savez(tmp_path / "ball.npz", t=t, gap_m=gap, i_cmd_A=1.0 + 150.0 * (gap - 6e-3))
    found = verified(guess_recording(tmp_path / "ball.npz"), tmp_path)
    assert found.channels["displacement"].scale == -1.0
    assert found.gains is not None and abs(found.gains["kp"] - 150.0) < 1e-3 and not found.controller.ask
