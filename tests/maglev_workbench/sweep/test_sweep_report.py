"""Sweep reports on datasets written by hand: order, JSON, escaping, and every layout of a sweep."""

import json
import subprocess
import sys
from io import StringIO
from itertools import product

import numpy as np
import pytest
import xarray as xr
from rich.console import Console

from maglev_env.evaluation.score import WEIGHTS
from maglev_workbench.commands.sweep.report import best_rows, gain_sets, sweep_page, sweep_summary, sweep_table
from maglev_workbench.page import number, page, with_interval, write_page
from tuning.swept_sets import SweptSets

PLOTLY = "plotly.js v"
BORDER = '"name":"stability border"'


def dataset(gains, feasible=None, score=None, name="hmb_free"):
    """A sweep dataset of gain sets (n, 3): kp, ki, kd; nan where infeasible, as `run_sweep` writes it."""
    gains = np.asarray(gains, dtype=float)
    n = len(gains)
    feasible = np.ones(n, bool) if feasible is None else np.asarray(feasible, bool)
    score = np.linspace(0.2, 0.8, n) if score is None else np.asarray(score)

    def known(value):
        return np.where(feasible, value, np.nan)

    one = {
        "stiffness": known(3e4 + gains[:, 0]),
        "stiffness_low": known(2.9e4 + gains[:, 0]),
        "stiffness_high": known(3.1e4 + gains[:, 0]),
        "damping": known(20 + gains[:, 2]),
        "damping_low": known(np.full(n, -np.inf)),
        "damping_high": known(np.full(n, np.inf)),
        "peak_sensitivity": known(np.linspace(1.5, 7, n)),
        "peak_sensitivity_se": known(np.full(n, 0.05)),
        "phase_margin": known(np.full(n, 30.0)),
        "gain_margin_low": np.full(n, np.nan),
        "gain_margin_high": known(np.full(n, 4.0)),
        "peak_displacement": np.full(n, 4e-5),
        "current_rms": np.full(n, 0.2),
        "touchdown_time": np.where(feasible, np.nan, 0.03),
        "pole_radius": np.where(feasible, 0.99, 1.01),
        "score": np.where(feasible, score, 0.0),
        "feasible": feasible,
    }
    one |= {f"term_{term}": known(np.full(n, 0.5)) for term in WEIGHTS}
    bands = {
        "band_stiffness": np.where(feasible[:, None], 3e4, np.nan) * np.ones((n, 5)),
        "band_damping": np.where(feasible[:, None], 20.0, np.nan) * np.ones((n, 5)),
        "band_stiffness_se": np.full((n, 5), 100.0),
        "band_damping_se": np.full((n, 5), 0.5),
    }
    variables = {k: ("experiment", v) for k, v in one.items()} | {
        k: (("experiment", "band"), v) for k, v in bands.items()
    }
    coordinates = {k: ("experiment", gains[:, j]) for j, k in enumerate(("kp", "ki", "kd"))}
    coordinates |= {"td": ("experiment", np.full(n, 1e-4)), "ti": ("experiment", np.full(n, 0.03))}
    low = np.arange(5.0) * 10 + 1
    coordinates |= {"experiment": np.arange(n), "band_low": ("band", low), "band_high": ("band", low + 15)}
    rig = {
        "name": name,
        "magnet": "hybrid_pair",
        "mass": 0.08,
        "target": {"band": [60.0, 120.0]},
        "protocol": {
            "excitations": [{"kind": "sphs", "at": "force", "fundamental": 1.0, "lines": [1, 2, 9], "amplitude": 1.0}]
        },
    }
    attributes = {"rig": json.dumps(rig), "log": "true", "sobol": "0", "seed": "7", "version": "0.1.0", "axes": "{}"}
    return xr.Dataset(variables, coordinates, {**attributes, "effects": "{}", "identity": "abc"})


def swept(*args, **changes):
    """That dataset as the report takes it."""
    return SweptSets.of_dataset(dataset(*args, **changes))


GRID = list(product((3e3, 6e3, 12e3), (100.0, 1000.0), (1.0, 2.0, 4.0, 8.0)))
HALF = [kd > kp / 5e3 for kp, _, kd in GRID]


def test_best_rows_come_best_first_and_hold_only_feasible_sets():
    data = swept(GRID[:4], [True, False, True, True], [0.2, 0.9, 0.7, 0.4])
    rows = best_rows(data)
    assert [r["experiment"] for r in rows] == [2, 3, 0]
    assert rows[0]["gains"] == {"kp": 3e3, "ki": 100.0, "kd": 4.0, "td": 1e-4, "ti": 0.03}
    assert rows[0]["stiffness_ci"] == [3.2e4, 3.4e4]
    assert rows[0]["damping_ci"] == [None, None]  # unbounded
    assert rows[0]["gain_margin_low"] is None
    assert list(rows[0]["terms"]) == list(WEIGHTS)
    assert [r["experiment"] for r in best_rows(data, 2)] == [2, 3]


def test_summary_counts_only_what_was_computed_now():
    data = swept(GRID, HALF)
    summary = sweep_summary(data, seconds=2.0, reused=14)
    json.dumps(summary, allow_nan=False)
    assert set(summary) == {"schema", "version", "n", "stable", "feasible", "best", "seconds",
                            "experiments_per_second", "reused"}  # fmt: skip
    assert (summary["schema"], summary["n"], summary["feasible"]) == ("maglev-sweep/1", 24, sum(HALF))
    assert summary["experiments_per_second"] == 5.0
    assert summary["best"]["score"] == pytest.approx(0.8)
    best = summary["best"]
    assert best["stiffness_ci"][0] < best["stiffness"] < best["stiffness_ci"][1]  # N/m
    assert {"gains", "terms", "damping", "damping_ci", "peak_sensitivity", "phase_margin"} <= set(best)
    assert sweep_summary(data, 2.0, reused=24)["experiments_per_second"] is None


def test_table_fits_110_columns():
    console = Console(width=200, file=StringIO())
    assert console.measure(sweep_table(swept(GRID, HALF))).maximum <= 110


def test_grid_page_has_one_plotly_the_border_and_a_slider_over_ki():
    html = sweep_page(swept(GRID, HALF))
    assert html.count(PLOTLY) == 1
    assert html.count(BORDER) == 8  # four maps, two values of ki
    assert '"sliders"' in html
    assert f"{24 - sum(HALF)} (" in html and "touched down" in html


def test_page_says_what_made_it_and_escapes_it():
    html = sweep_page(swept(GRID, HALF, name="<script>alert(1)</script>"))
    assert "<script>alert" not in html
    assert "&lt;script&gt;alert(1)" in html
    assert "3 lines from 1 to 9 Hz, peak 1 N" in html
    assert "0.1.0" in html and "Seed" in html


def test_two_swept_gains_have_no_slider():
    plane = [g for g in GRID if g[1] == 100.0]
    html = sweep_page(swept(plane, [kd > kp / 5e3 for kp, _, kd in plane]))
    assert html.count(BORDER) == 4
    assert '"sliders"' not in html


def test_one_swept_gain_gives_lines_with_the_border():
    html = sweep_page(swept([(8e3, 100.0, kd) for kd in (1.0, 2.0, 4.0, 8.0)], [False, True, True, True]))
    assert html.count(BORDER) == 4
    assert "Over kd" in html
    assert '"type":"heatmap","xaxis"' not in html and "Maps over" not in html


def test_scattered_sets_give_points():
    gains = np.random.default_rng(0).uniform((3e3, 100, 1), (2e4, 1e4, 20), (16, 3))
    html = sweep_page(swept(gains, np.arange(16) % 3 > 0))
    assert "Points over the gains" in html
    assert html.count(PLOTLY) == 1


def test_one_gain_set():
    assert gain_sets(1) == "1 gain set" and gain_sets(4) == "4 gain sets"
    html = sweep_page(swept(GRID[:1]))
    assert "1 of 1 gain set is feasible" in html
    assert "Maps over" not in html


def test_nothing_feasible():
    data = swept(GRID, np.zeros(len(GRID), bool))
    assert best_rows(data) == []
    summary = sweep_summary(data, 1.0, 0)
    assert summary["best"] is None and summary["stable"] == 0
    html = sweep_page(data)
    assert "no best gain set" in html and "Nearest to a stable loop" in html
    Console(file=StringIO()).print(sweep_table(data))


@pytest.mark.parametrize("feasible", [np.ones(24, bool), np.arange(24) == 5])
def test_a_border_free_grid_and_a_lone_survivor(feasible):
    assert sweep_page(swept(GRID, feasible)).count(PLOTLY) == 1


def test_equal_datasets_give_equal_pages():
    assert sweep_page(swept(GRID, HALF)) == sweep_page(swept(GRID, HALF))


def test_numbers_are_written_to_what_their_intervals_give():
    assert with_interval(43.0361, 42.8, 43.28) == "43.04 ±0.24"
    assert with_interval(13.0, 12.0, 18.0) == "13.0 [12.0, 18.0]"
    assert with_interval(13.0, 12.0, np.inf) == "13.0 [12.0, ∞]"
    assert with_interval(143.77, 143.76, 143.78) == "143.8 ±0.01"
    assert with_interval(None, None, None) == "–"
    assert [number(v) for v in (1234.5, 0.01234, 0.0, None, np.nan, -2.0)] == [
        "1234",
        "0.0123",
        "0.00",
        "–",
        "–",
        "-2.00",
    ]


def test_page_escapes_plain_text_and_is_written_whole(tmp_path):
    html = page("<b>", "a & b", [("<i>", "<p>kept</p>")], {"<k>": "<v>"})
    for text in ("<title>&lt;b&gt;", "a &amp; b", "<h2>&lt;i&gt;</h2>", "<p>kept</p>", "&lt;k&gt;", "&lt;v&gt;"):
        assert text in html
    assert PLOTLY not in html
    write_page(tmp_path / "a.html", html)
    assert [f.name for f in tmp_path.iterdir()] == ["a.html"]
    assert (tmp_path / "a.html").read_text() == html


def test_a_goal_without_limits_has_a_page_without_bars():
    data = dataset(GRID, HALF)
    rig = {**json.loads(data.attrs["rig"]), "target": {"goal": "best compliance near 2e-5"}}
    known = {"required_compliance": ("experiment", np.full(len(GRID), 1.9e-5)),
             "required_noise_current": ("experiment", np.full(len(GRID), 0.02))}  # fmt: skip
    data = data.assign_attrs(rig=json.dumps(rig)).assign(known)
    html = sweep_page(SweptSets.of_dataset(data))
    assert "The best set and its goal" in html and "as good as possible" in html
    assert "Requirements of" not in html and "requirement." not in html


def test_a_loop_that_touches_down_is_stable_and_not_feasible():
    data = dataset(GRID, HALF)
    data["pole_radius"] = ("experiment", np.full(len(GRID), 0.99))
    summary = sweep_summary(SweptSets.of_dataset(data), 1.0, 0)
    assert (summary["stable"], summary["feasible"]) == (len(GRID), sum(HALF))


def test_gains_of_filters_are_shown_where_they_differ():
    sets = np.array(list(product([8000.0], [2000.0], [5.0], [600.0, 700.0], [0.1, 0.3])))
    filters = {"notch_frequency": ("experiment", sets[:, 3]), "notch_depth": ("experiment", sets[:, 4])}
    filters |= {"notch_width": ("experiment", np.full(len(sets), 0.5))}
    d = SweptSets.of_dataset(dataset(sets[:, :3]).assign_coords(filters))
    wanted = {"notch_frequency": 700.0, "notch_depth": 0.3, "notch_width": 0.5}
    assert best_rows(d, 1)[0]["gains"].items() >= wanted.items()
    heads = [column.header for column in sweep_table(d).columns]
    assert "notch frequency\nHz" in heads and "notch width\n" not in heads
    shown = sweep_page(d)
    assert "notch_frequency 700 Hz, notch_depth 0.300 with score 0.800" in shown
    assert "notch_frequency in Hz" in shown and "Maps over the gains" in shown


LIGHT = """
import sys
from maglev_workbench.cli import app
try:
    app(["sweep", "--kp", "8000:9000:2", "--kd", "5:6:2", "--out", sys.argv[1], "--quiet"])
except SystemExit as end:
    assert not end.code
print(*(name for name in ("xarray", "pandas", "dask.array", "scipy.stats", "scipy.interpolate") if name in sys.modules))
"""


def test_a_sweep_imports_nothing_that_takes_longer_than_itself(tmp_path):
    command = [sys.executable, "-c", LIGHT, tmp_path / "out"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "" and (tmp_path / "out" / "sweep.html").exists()
