"""Estimate reports on identifications written by hand: JSON schema, trust, escaping, missing and unbounded values."""

import json
from dataclasses import fields, replace
from io import StringIO
from math import inf, nan

import numpy as np
import pytest
from rich.console import Console

from estimation.lines.frequency_response import Distortion
from estimation.lines.periods import LineStatistics
from estimation.modal import ModalEstimate
from estimation.stability_margins import Margins
from maglev_env.evaluation.bands import Band
from maglev_env.evaluation.identification import Identification
from maglev_env.evaluation.stability import Stability
from maglev_workbench.commands.estimate.report import estimate_json, estimate_page, estimate_table, trust


def band(f_lo, **changes):
    values = {
        "f_lo": f_lo, "f_hi": f_lo + 15, "stiffness": 3e4, "stiffness_se": 50.0, "stiffness_ci": (2.99e4, 3.01e4),
        "damping": 30.0, "damping_se": 0.5, "damping_ci": (29.0, 31.0), "r2_adjusted": 0.99, "ls_stiffness": 2.9e4,
        "ls_stiffness_se": 100.0, "ls_damping": 28.0, "ls_damping_se": 1.0, "ls_biased": False, "informative": True,
        "fit_p": 0.4, "noise_share": 0.01, "effective_stiffness": None, "effective_damping": None,
    }  # fmt: skip
    return Band(**{**values, **changes})


BANDS = (
    band(1.0, effective_stiffness=3.1e4, effective_damping=31.0),
    band(4.0, ls_biased=True),
    band(7.0, informative=False, stiffness_ci=(-inf, inf), damping_ci=(2.0, inf), stiffness_se=nan),
)
MARGINS = Margins(
    2.2, 90.0, 5.0, 800.0, None, None, 25.0, 120.0, 4e-4, 150.0, 0.4, 100.0,
    {"gain_margin_low": "the phase of L does not cross -180 deg"},
    {"peak_sensitivity": (2.1, 2.3), "gain_margin_high": (4.0, None), "phase_margin": (24.0, 26.0)},
)  # fmt: skip
LINES = np.arange(1, 21)


def statistics():
    w = 2 * np.pi * LINES * 10.0
    mean = np.stack([1 / (3e4 - 0.08 * w**2 + 30j * w), np.ones(20, complex)])
    covariance = np.zeros((2, 2, 20), complex)
    covariance[0, 0] = 1e-13
    covariance[0, 0, -1] = 1.0  # a line of pure noise
    return LineStatistics(LINES * 10.0, LINES, ("displacement", "force"), mean, covariance, 5)


def identification(**changes):
    sensitivity = 1 + 0.5j * np.linspace(1, 3, 20)
    stability = Stability("injection", MARGINS, "A", LINES * 10.0, sensitivity, np.full(20, 1e-3))
    values = {
        "bands": BANDS, "mass": 0.08, "modal": None, "actuator": None, "natural_frequency": 97.0, "damping_ratio": 0.3,
        "distortion": Distortion(None, 0.01, None, 0.2, 0.003), "stability": stability, "transient_periods": 1,
        "periods": 5, "statistics": statistics(), "notes": ("one <b>note</b>",),
    }  # fmt: skip
    return Identification(**{**values, **changes})


def text_of(table, width=120):
    console = Console(width=width, record=True, file=StringIO())
    console.print(table)
    return console.export_text()


@pytest.mark.parametrize("method", ["ls", "ml"])
def test_json_of_one_method_has_the_schema(method):
    data = estimate_json([("run1.mat", identification())], method)
    json.dumps(data, allow_nan=False)
    assert data["schema"] == "maglev-estimate/1"
    (recording,) = data["recordings"]
    assert set(recording) == {
        "file", "bands", "mass", "mass_se", "actuator", "natural_frequency", "damping_ratio", "distortion", "stability",
        "transient_periods", "periods", "notes", "gain_over_frequency",
    }  # fmt: skip
    assert set(recording["bands"][0]) == {
        "f_lo", "f_hi", "stiffness", "stiffness_se", "stiffness_ci", "damping", "damping_se", "damping_ci",
        "r2_adjusted", "method", "ls_biased", "informative", "stiffness_range", "damping_range",
    }  # fmt: skip
    assert [b["method"] for b in recording["bands"]] == [method] * 3


def test_json_of_both_methods_has_two_entries_per_band():
    bands = estimate_json([("run1.mat", identification())], "both")["recordings"][0]["bands"]
    assert [b["method"] for b in bands] == ["ml", "ls"] * 3
    assert bands[1]["stiffness"] == 2.9e4
    assert bands[1]["stiffness_ci"] == pytest.approx([2.9e4 - 196, 2.9e4 + 196])
    assert bands[4]["stiffness_ci"] == [None, None] and bands[4]["damping_ci"] == [2.0, None]
    assert bands[4]["stiffness_se"] is None


def test_json_of_stability_and_mass():
    modal = ModalEstimate(**{**{f.name: 0.3 for f in fields(ModalEstimate)}, "mass": 0.081, "mass_se": 1e-4})
    data = estimate_json([("a", identification(modal=modal)), ("b", identification(stability=None))], "ml")
    first, second = data["recordings"]
    assert first["mass_se"] == 1e-4 and second["mass_se"] is None
    assert second["stability"] is None
    assert first["stability"]["source"] == "injection"
    assert first["stability"]["gain_margin_low"] is None
    assert first["stability"]["phase_margin_frequency"] == 120.0
    assert first["stability"]["intervals"]["gain_margin_high"] == [4.0, None]
    assert first["stability"]["reasons"]["gain_margin_low"].startswith("the phase")
    assert first["stability"]["iso_14839_3_zone"] == "A"
    assert first["distortion"] == {"even": None, "odd": 0.01, "even_p": None, "odd_p": 0.2, "noise": 0.003}


def test_table_says_what_to_trust():
    table = estimate_table(identification(), "both")
    assert list(table.columns[-1].cells) == ["either", "ML", "uninformative"]
    assert [row.style for row in table.rows] == ["", "yellow", "dim"]
    text = text_of(table)
    assert "30.00 ±0.10" in text and "29.00 ±0.20" in text and "∞" in text


def test_a_fit_that_is_worse_than_a_constant_is_not_trusted():
    assert trust(band(1.0, r2_adjusted=-0.23)) == "poor fit"
    none = {"stiffness_ci": (-50.0, 20.0), "damping_ci": (-1.0, 2.0)}  # it claims nothing, and rightly
    assert trust(band(1.0, r2_adjusted=-0.02, **none)) == "either"


@pytest.mark.parametrize(("method", "columns"), [("ls", 5), ("ml", 5), ("both", 7)])
def test_table_shows_the_methods_asked_for(method, columns):
    assert len(estimate_table(identification(), method).columns) == columns


def test_a_long_table_is_thinned_and_says_so():
    table = estimate_table(identification(bands=tuple(band(float(f)) for f in range(1, 79))), "ml")
    assert len(table.rows) == 26
    assert "One band in 3 of 78" in text_of(table)
    assert len(estimate_table(identification(bands=tuple(band(float(f)) for f in range(30))), "ml").rows) == 30


def test_page_is_one_file_and_escapes_what_users_write():
    evil = "<script>alert(1)</script>.mat"
    html = estimate_page([(evil, identification()), ("run2.csv", identification())], {"Campaign": "<i>mine</i>"})
    assert html.count("plotly.js v") == 1
    assert "<script>alert" not in html and "<b>note" not in html and "<i>mine" not in html
    assert "&lt;script&gt;alert(1)" in html and "one &lt;b&gt;note&lt;/b&gt;" in html
    shown = ("in dB re 1 m/N", "A | B at 3", "promised by the gains", "ML, unbounded", "L does not cross")
    assert [text for text in shown if text not in html] == []


def test_more_sections_follow_the_recordings():
    more = [[("x and y together", "<p>first</p>"), ("", "<p>second</p>")], [("another loop", "<p>third</p>")]]
    html = estimate_page([("run1.mat", identification())], more=more)
    shown = ("Notes on run1.mat", "x and y together", "<p>first</p>", "<p>second</p>", "another loop", "<p>third</p>")
    order = [html.index(text) for text in shown]
    assert order == sorted(order) and order[-1] < html.index("What made this page")


@pytest.mark.parametrize(
    "changes",
    [
        {"stability": None, "natural_frequency": None, "damping_ratio": None, "notes": ()},
        {"bands": (BANDS[2],)},
        {"bands": (BANDS[0],)},
    ],
)
def test_pages_of_poor_records(changes):
    html = estimate_page([("run1.mat", identification(**changes))])
    assert html.startswith("<!DOCTYPE html>")


def test_margins_without_intervals():
    found = identification()
    bare = replace(found.stability, margins=replace(MARGINS, intervals={}))
    assert "2.20 at 90.0 Hz" in estimate_page([("a", replace(found, stability=bare))])
