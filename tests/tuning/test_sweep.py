"""Sweeps: the gain sets, the folder, and that an interrupted sweep equals an uninterrupted one bit for bit."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from short_sweeps import short_rig, short_sweep

from maglev_env.design.controllers import with_controller
from maglev_env.loop.controller_forms import Pid, StateFeedback
from maglev_env.loop.effect import effect
from maglev_env.loop.linear_controller import LinearController
from maglev_env.rig.rig_file import load_rig
from tuning import sweep_run as module
from tuning.axis import Axis, parse_axes, parse_axis
from tuning.sweep import Sweep, default_axes, gain_sets
from tuning.sweep_run import run_sweep
from tuning.swept_sets import SweptSets


@pytest.fixture
def rig():
    return short_rig()


def test_grids_and_sobol_points_are_what_they_say(rig):
    grid = gain_sets(short_sweep(rig))
    assert (
        len(grid) == 20 and (grid[0].kp, grid[0].kd) == (4000.0, 0.5) and (grid[-1].kp, grid[-1].kd) == (12000.0, 8.0)
    )
    assert grid[1].kd > grid[0].kd and grid[1].kp == grid[0].kp and grid[0].ki == rig.gains.ki
    log = gain_sets(short_sweep(rig, log=True))
    assert log[1].kd / log[0].kd == pytest.approx(log[2].kd / log[1].kd) == pytest.approx(2.0)
    sobol = gain_sets(short_sweep(rig, sobol=37))
    assert len({g.kp for g in sobol}) == 37 and all(4000 <= g.kp <= 12000 and 0.5 <= g.kd <= 8 for g in sobol)
    assert sobol == gain_sets(short_sweep(rig, sobol=37)) != gain_sets(short_sweep(rig, sobol=37, seed=4))
    assert len(gain_sets(Sweep(rig, default_axes(rig), log=True))) == 1024


def test_axes_are_read_and_refused_as_the_command_line_writes_them(rig):
    assert parse_axis("1:2:3") == Axis(1.0, 2.0, 3) and parse_axis("5") == Axis(5.0, 5.0, 1)
    for text in ("1:2", "a:b:c", "1:2:3.5", ""):
        with pytest.raises(ValueError, match="lo:hi:n"):
            parse_axis(text)
    for changes, words in (
        ({"axes": {"kp": Axis(2.0, 1.0, 3)}}, "lo <= hi"),
        (
            {"axes": {"kq": Axis(1.0, 2.0, 3)}},
            "'kq' is not one of the gains .*: kp, ki, kd, td, ti",
        ),
        ({"axes": {}}, "at least one"),
        ({"axes": {"kp": Axis(0.0, 1.0, 3)}, "log": True}, "above 0"),
    ):
        with pytest.raises(ValueError, match=words):
            short_sweep(rig, **changes)
    with pytest.raises(ValueError, match="nothing to sweep"):
        Sweep(load_rig("pedestal"), {"kp": Axis(1.0, 2.0, 2)})


def test_a_resumed_sweep_equals_an_uninterrupted_one_bit_for_bit(rig, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "CHUNK", 6)
    whole = run_sweep(short_sweep(rig), tmp_path / "whole")
    done = []

    def interrupt(count, reused):
        done.append(count)
        if len(done) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(short_sweep(rig), tmp_path / "cut", progress=interrupt)
    finished = sorted((tmp_path / "cut" / "chunks").iterdir())
    assert 1 <= len(finished) < 4 and not (tmp_path / "cut" / "sweep.nc").exists()
    again = []
    resumed = run_sweep(
        short_sweep(rig), tmp_path / "cut", threads=1, progress=lambda n, reused: again.append((n, reused))
    )
    assert resumed.identical(whole)
    assert sum(n for n, reused in again if reused) == 6 * len(finished) and sum(n for n, _ in again) == 20


def test_a_sweep_in_processes_equals_one_on_threads_bit_for_bit(rig, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "CHUNK", 6)
    whole, told = run_sweep(short_sweep(rig), tmp_path / "threads", threads=2), []
    monkeypatch.setattr(module, "IN_PROCESSES", 20)
    apart = run_sweep(short_sweep(rig), tmp_path / "apart", 2, lambda n, reused: told.append(n), processes=True)
    assert apart.identical(whole) and sorted(told) == [2, 6, 6, 6]


PLAIN_SCRIPT = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from short_sweeps import short_rig, short_sweep
from tuning import sweep_run
print("runs", flush=True)
sweep_run.IN_PROCESSES, sweep_run.CHUNK = 20, 6
print(sweep_run.run_sweep(short_sweep(short_rig()), Path("out"), threads=2).sizes["experiment"])
"""


@pytest.mark.slow
def test_a_script_without_a_main_guard_is_run_once_by_a_large_sweep(tmp_path):
    (tmp_path / "plain.py").write_text(PLAIN_SCRIPT)
    models = Path(__file__).parents[1] / "models"
    ran = subprocess.run(
        [sys.executable, "plain.py", str(models)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ran.stdout.split() == ["runs", "20"], ran.stderr


def test_a_folder_of_another_sweep_is_not_touched(rig, tmp_path):
    small = {"kp": Axis(8000.0, 8000.0, 1)}
    run_sweep(short_sweep(rig, axes=small), tmp_path / "mine")
    for words, changed in (("another seed", {"seed": 4}), ("another effects", {"effects": effect("delay", 5e-5)})):
        with pytest.raises(ValueError, match=f"holds a sweep of {words}"):
            run_sweep(short_sweep(rig, axes=small, **changed), tmp_path / "mine")
    (tmp_path / "mine" / "chunks" / "0000000.npz").write_bytes(b"PK\x03\x04 no")
    with pytest.raises(ValueError, match=r"0000000\.npz is damaged .*delete it"):
        run_sweep(short_sweep(rig, axes=small), tmp_path / "mine")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("do not lose me")
    with pytest.raises(ValueError, match="not empty"):
        run_sweep(short_sweep(rig, axes=small), tmp_path / "full")


def test_the_dataset_says_what_made_it_and_holds_every_gain_set(rig, tmp_path):
    d = run_sweep(short_sweep(rig, effects=effect("delay", 5e-5)), tmp_path / "out")
    assert d.sizes["experiment"] == 20 and {"kp", "ki", "kd", "td", "ti", "band_low"} <= set(d.coords)
    assert '"delay"' in d.attrs["effects"] and d.attrs["version"] and d.attrs["seed"] == "3"
    units = [d[name].attrs.get("units") for name in ("kp", "td", "stiffness", "phase_margin", "band_low", "score")]
    assert units == ["A/m", "s", "N/m", "deg", "Hz", None]
    stable = d.feasible.values
    assert 0 < stable.sum() < 20
    assert (d.score.values[~stable] == 0).all() and (d.score.values[stable] > 0).all()
    assert np.isfinite(d.stiffness.values[stable]).all() and np.isnan(d.touchdown_time.values[stable]).all()


def test_a_file_read_by_columns_holds_what_the_dataset_holds(rig, tmp_path):
    d = run_sweep(short_sweep(rig), tmp_path / "out")
    by_columns, by_dataset = SweptSets.of_file(tmp_path / "out" / "sweep.nc"), SweptSets.of_dataset(d)
    assert by_columns.names == by_dataset.names and set(by_columns.gains) == {"kp", "ki", "kd", "td", "ti"}
    assert by_columns.attrs == by_dataset.attrs == d.attrs and len(by_columns) == 20
    for name in (*by_columns.names, *by_columns.gains, "experiment", "band_low", "band_high"):
        assert by_columns[name].dtype == d[name].dtype
        np.testing.assert_array_equal(by_columns[name], d[name].values)
    rows = np.array([7, 2])
    for sets in (by_columns, by_dataset):
        np.testing.assert_array_equal(sets.in_bands("band_stiffness", rows), d.band_stiffness.values[rows])
        np.testing.assert_array_equal(sets.some(rows)["score"], d.score.values[rows])
        np.testing.assert_array_equal(sets.some(rows).some(np.array([1]))["score"], d.score.values[rows[1:]])


def test_a_form_is_swept_where_it_has_the_gains(rig):
    own = Pid(8000.0, 2e4, 5.2, 1e-4, "measurement")
    two = Sweep(replace(rig, gains=own), {"kp": Axis(7000.0, 8000.0, 2)})
    assert gain_sets(two) == [replace(own, kp=7000.0), own]
    other = replace(rig, gains=StateFeedback(8000.0, 5.2, 0.1))
    with pytest.raises(ValueError, match="its controller has no kp, ki, kd"):
        default_axes(other)
    with pytest.raises(ValueError, match="'kp' is not one of the gains of the rig's controller: displacement"):
        Sweep(other, {"kp": Axis(7000.0, 8000.0, 2)})
    assert gain_sets(Sweep(other, {"velocity": Axis(5.0, 6.0, 2)}))[1] == StateFeedback(8000.0, 6.0, 0.1)
    by_numbers = replace(rig, gains=LinearController((8000.0,), (1.0,)))
    with pytest.raises(ValueError, match="given by numerator and denominator"):
        Sweep(by_numbers, {"kp": Axis(7000.0, 8000.0, 2)})


def test_filters_are_swept_beside_the_gains(rig):
    noted = with_controller(rig, "pid + notch 650")
    sets = gain_sets(Sweep(noted, {"notch_frequency": Axis(600.0, 700.0, 2), "kp": Axis(7000.0, 8000.0, 2)}))
    assert [(g.kp, g.notch.frequency) for g in sets] == [(7e3, 600.0), (7e3, 700.0), (8e3, 600.0), (8e3, 700.0)]
    for axis, words in (
        ({"notch_frequency": Axis(600.0, 2e4, 2)}, "half of the control rate"),
        ({"notch_depth": Axis(-0.5, 0.5, 2)}, "depth = -0.5"),
    ):
        with pytest.raises(ValueError, match=words):
            Sweep(noted, axis)


def test_axes_are_named_as_the_command_line_names_them():
    assert parse_axes(["kp=1:2:3", "notch_depth=0.1"]) == {"kp": Axis(1.0, 2.0, 3), "notch_depth": Axis(0.1, 0.1, 1)}
    for texts, words in ((["kp"], "not name=lo:hi:n"), (["kp=1", "kp=2"], "twice")):
        with pytest.raises(ValueError, match=words):
            parse_axes(texts)
