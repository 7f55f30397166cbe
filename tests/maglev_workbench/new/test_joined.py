"""Runs whose channels lie in files of their own."""

import numpy as np
from command_line import maglev

from maglev_env.recordings.files import read_columns


def instruments(folder, run, rate, other, offset=0.0):
    t = np.arange(int(4 * rate)) / rate
    slow = np.arange(int(4 * other)) / other + offset
    gap = 4 + 0.1 * np.sin(2 * np.pi * 3 * t)
    current = 1.2 + 0.1 * np.cos(2 * np.pi * 3 * slow)
    np.savetxt(folder / f"{run}_laser.csv", np.c_[t, gap], "%.7f", ",", header="time_s,laser_mm", comments="")
    np.savetxt(folder / f"{run}_amp.csv", np.c_[slow, current], "%.7f", ",", header="time_s,current_A", comments="")
    return slow, current


def test_files_of_one_run_are_joined_at_the_slower_rate_and_said(tmp_path):
    slow, current = instruments(tmp_path, "run1", 2000.0, 800.0)
    instruments(tmp_path, "run2", 2000.0, 800.0)
    result = maglev("new", tmp_path)
    assert "Read 2 of 2 file(s)" in result and "run1_laser.csv (2000 Hz)" in result
    joined = read_columns(tmp_path / "run1_joined.csv")
    assert joined.names == ("time [s]", "laser_mm", "current_A")
    np.testing.assert_allclose(joined.column("current_A"), current, atol=1e-6)
    np.testing.assert_allclose(joined.column("laser_mm"), 4 + 0.1 * np.sin(2 * np.pi * 3 * slow), atol=1e-5)
    again = maglev("new", tmp_path, "--force")
    assert "Read 2 of 2 file(s)" in again
    assert "check" in maglev("check", tmp_path)


def test_clocks_that_do_not_overlap_are_not_joined(tmp_path):
    instruments(tmp_path, "run1", 1000.0, 1000.0, offset=100.0)
    output = maglev("new", tmp_path)
    assert "Read 1 of 2 file(s)" in output and "copy its columns" in output.replace("\n", "")
