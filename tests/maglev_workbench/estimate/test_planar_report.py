"""Reports of x-y identification on results written by hand: places and units of every number, refusals, layout."""

import json
from dataclasses import replace
from io import StringIO
from math import inf, nan

import numpy as np
import pytest
from rich.console import Console

from estimation.lines.periods import LineStatistics
from estimation.max_likelihood import BandEstimate
from estimation.xy.planar import PlanarEstimate, RowSums, row_sums
from estimation.xy.planar_least_squares import PlanarLeastSquares
from estimation.xy.planar_lines import CHANNELS
from maglev_env.evaluation.identification_planar import PlanarIdentification
from maglev_workbench.commands.estimate.planar_report import planar_json, planar_sections, planar_table
from maglev_workbench.page import page

K, C = np.array([[130e3, 8e3], [-6e3, 125e3]]), np.array([[20.0, 3.0], [-2.0, 25.0]])
K_SE, C_SE = np.array([[100.0, 200.0], [300.0, 400.0]]), np.array([[0.1, 0.2], [0.3, 0.4]])
SUPPORT_K, SUPPORT_C = np.diag([95e3, 90e3]), np.diag([5.0, 6.0])
FILES = "run1.npz + run2.npz"


def every(matrix, known):
    """A matrix in every known band, nan in the others."""
    return np.where(known[:, None, None], matrix, nan)


def one_axis(stiffness, damping, n):
    k, c, ones = np.full(n, stiffness), np.full(n, damping), np.ones(n)
    bounds = (k - 2e3, k + 2e3, c - 4.0, c + 4.0)
    return BandEstimate(k, c, 1e3 * ones, 2.0 * ones, *bounds, ones, 0.5 * ones, np.ones(n, bool), 0.01 * ones)


def identification(known=(True, True, True), support=False, recordings=2, **changes):
    """K and C with 95 % at +-2 standard errors where known; changes: fields of the estimate."""
    known = np.asarray(known)
    n = len(known)
    low = np.arange(n) * 10.0 + 5
    ones = np.where(known, 1.0, nan)
    parts = {
        "stiffness": every(K, known), "damping": every(C, known),
        "stiffness_se": every(K_SE, known), "damping_se": every(C_SE, known),
        "stiffness_low": every(K - 2 * K_SE, known), "stiffness_high": every(K + 2 * K_SE, known),
        "damping_low": every(C - 2 * C_SE, known), "damping_high": every(C + 2 * C_SE, known),
        "stiffness_inflation": np.full((n, 2, 2), 1.5), "damping_inflation": np.full((n, 2, 2), 1.25),
        "cost": 30 * ones, "fit_p": 0.4 * ones, "informative": known.copy(), "noise_share": np.full(n, 0.01),
        "condition": np.where(known, 2.5, inf), "identifiable": known,
    }  # fmt: skip
    estimate = PlanarEstimate(**{**parts, **changes})
    whole, yes = np.ones(n, bool), np.ones((n, 2, 2), bool)
    squares = PlanarLeastSquares(
        every(K + 1e3, whole), every(C + 1, whole), every(K_SE, whole), every(C_SE, whole), every(K / K_SE, whole),
        every(C / C_SE, whole), yes, yes, np.full((n, 2), 0.99), np.tile([0.98, 0.97], (n, 1)), np.full(n, 4.0),
    )  # fmt: skip
    sums = tuple(
        RowSums(one_axis(138e3 + i, 23.0, n), one_axis(119e3, 23.5, n), np.full(n, 1 + 0.1j), np.full(n, 0.02))
        for i in range(recordings)
    )
    bearing = (estimate.stiffness - SUPPORT_K, estimate.damping - SUPPORT_C) if support else (None, None)
    bands = np.stack([low, low + 15], axis=1)
    return PlanarIdentification(bands, (0.92, 0.9), estimate, squares, sums, *bearing, ("one <b>note</b>",))


def text_of(table, width=100):
    console = Console(width=width, record=True, file=StringIO())
    console.print(table)
    return console.export_text()


def cells_of(table):
    """Rows of a table that hold a band."""
    rows = zip(*(column.cells for column in table.columns), strict=True)
    return [row for row in rows if "–" in row[0]]


def page_of(found, files=FILES):
    return page("x-y", "", planar_sections(files, found), {})


def figures_of(found, files=FILES):
    return [content for _, content in planar_sections(files, found) if not isinstance(content, str)]


def panel(figure, place):
    """Traces of the nth panel of a figure by name."""
    axis = "y" if place == 0 else f"y{place + 1}"
    return {trace.name: trace for trace in figure.data if trace.yaxis == axis}


def test_json_holds_every_coefficient_in_its_place():
    data = planar_json(FILES, identification(support=True))
    json.dumps(data, allow_nan=False)
    assert set(data) == {"files", "masses", "bands", "notes"}
    assert data["files"] == FILES and data["masses"] == [0.92, 0.9] and data["notes"] == ["one <b>note</b>"]
    band = data["bands"][1]
    assert {k: band[k] for k in ("f_lo", "f_hi", "condition", "identifiable", "informative", "fit_p")} == {
        "f_lo": 15.0, "f_hi": 30.0, "condition": 2.5, "identifiable": True, "informative": True, "fit_p": 0.4,
    }  # fmt: skip
    assert band["stiffness"]["xy"] == {"value": 8e3, "se": 200.0, "ci": [7600.0, 8400.0]}
    assert band["stiffness"]["yx"] == {"value": -6e3, "se": 300.0, "ci": [-6600.0, -5400.0]}
    assert band["damping"]["yy"] == {"value": 25.0, "se": 0.4, "ci": [24.2, 25.8]}
    assert band["bearing_stiffness"]["xx"] == {"value": 35e3, "se": 100.0, "ci": [34800.0, 35200.0]}
    assert band["bearing_stiffness"]["xy"]["value"] == 8e3
    assert band["bearing_damping"]["yy"]["ci"] == pytest.approx([18.2, 19.8])
    assert band["inflation"]["stiffness"]["yx"] == 1.5 and band["inflation"]["damping"]["xx"] == 1.25
    assert band["least_squares"]["r2_adjusted"] == {"x": 0.98, "y": 0.97}
    assert band["least_squares"]["stiffness"]["yx"]["ci"] == pytest.approx([-5e3 - 588, -5e3 + 588], abs=0.1)
    assert band["row_sums"][1]["x"] == {
        "stiffness": 138001.0, "stiffness_ci": [136001.0, 140001.0], "damping": 23.0, "damping_ci": [19.0, 27.0],
    }  # fmt: skip
    assert band["row_sums"][0]["y"]["stiffness"] == 119e3
    assert band["row_sums"][0]["ratio"] == {"re": 1.0, "im": 0.1} and band["row_sums"][0]["ratio_spread"] == 0.02


def test_json_of_bands_that_are_refused_or_unbounded():
    high = every(K + 2 * K_SE, np.ones(2, bool))
    high[0, 0, 1] = inf
    found = identification(known=(True, False), stiffness_high=high, informative=np.zeros(2, bool))
    free, refused = planar_json(FILES, found)["bands"]
    assert free["stiffness"]["xy"]["ci"] == [7600.0, None] and free["informative"] is False
    assert free["bearing_stiffness"] is None and free["bearing_damping"] is None
    nothing = {"value": None, "se": None, "ci": [None, None]}
    assert refused["condition"] is None and refused["identifiable"] is False
    assert [v for name in ("stiffness", "damping") for v in refused["least_squares"][name].values()] == [nothing] * 8
    assert refused["least_squares"]["r2_adjusted"] == {"x": None, "y": None}
    assert refused["damping"]["xx"] == nothing
    assert refused["row_sums"][0]["x"]["stiffness"] == 138e3


def test_table_has_blocks_of_stiffness_damping_and_bearing():
    rows = cells_of(planar_table(identification(known=(True,), support=True)))
    assert rows == [
        ("5–20", "130.0 ±0.2", "8.00 ±0.40", "-6.00 ±0.60", "125.0 ±0.8", "2.50"),
        ("5–20", "20.00 ±0.20", "3.00 ±0.40", "-2.00 ±0.60", "25.00 ±0.80", "good"),
        ("5–20", "35.00 ±0.20", "35.00 ±0.80", "15.00 ±0.20", "19.00 ±0.80", ""),
    ]
    assert "less the rig's support" in text_of(planar_table(identification(support=True)))
    assert "support" not in text_of(planar_table(identification()))


def test_a_refused_band_says_so_and_gives_its_row_sums():
    table = planar_table(identification(known=(True, False)))
    rows = cells_of(table)
    assert [row[0] for row in rows] == ["5–20", "15–30", "5–20", "15–30"]
    assert rows[1][1:] == ("–", "–", "–", "–", "∞")
    assert rows[3][1:] == ("138.0 ±2.0", "119.0 ±2.0", "23.0 ±4.0", "23.5 ±4.0", "1.00 ∠6°")
    text = " ".join(text_of(table).split())
    assert "Condition number above 30: x and y move along one line" in text and "first recording's" in text
    assert "one line" not in text_of(planar_table(identification()))


def test_a_table_of_refused_bands_only_has_row_sums_only():
    table = planar_table(identification(known=(False, False), recordings=1))
    assert [row[1] for row in cells_of(table)] == ["138.0 ±2.0"] * 2
    text = text_of(table)
    assert "In every band" in text and "k_xy" in text and "condition" not in text and "first recording" not in text


@pytest.mark.parametrize(
    ("changes", "trust", "style"),
    [
        ({}, "good", ""),
        ({"informative": np.array([False])}, "unbounded", "dim"),
        ({"fit_p": np.array([1e-9])}, "good", ""),  # adjusted R2 still explains the band
    ],
)
def test_what_to_trust(changes, trust, style):
    table = planar_table(identification(known=(True,), **changes))
    assert cells_of(table)[1][-1] == trust and table.rows[0].style == style


def test_a_poor_fit_needs_both_p_and_r2():
    found = identification(known=(True,), fit_p=np.array([1e-9]))
    poor = replace(found, least_squares=replace(found.least_squares, r2_adjusted=np.array([[0.95, 0.5]])))
    table = planar_table(poor)
    assert cells_of(table)[1][-1] == "poor fit" and table.rows[0].style == "yellow"
    assert "Yellow" in text_of(table) and "Yellow" not in text_of(planar_table(found))


@pytest.mark.parametrize(("width", "support"), [(80, False), (100, True)])
def test_tables_fit_a_terminal(width, support):
    text = text_of(planar_table(identification(known=(True, False, True), support=support)), width)
    assert "…" not in text and max(map(len, text.splitlines())) <= width
    assert "-6.00 ±0.60" in text and "+ k_yx / r" in text


@pytest.mark.parametrize(
    ("known", "support"),
    [
        (np.ones(78, bool), False),
        (np.ones(78, bool), True),
        (np.zeros(31, bool), False),
        (np.arange(40) % 2 == 0, False),
        (np.arange(40) % 2 == 1, True),
    ],
)
def test_a_long_table_is_thinned_and_says_so(known, support):
    table = planar_table(identification(known=known, support=support))
    assert 10 <= len(cells_of(table)) <= 30
    assert f"of {len(known)} is shown" in text_of(table)
    assert "is shown" not in text_of(planar_table(identification(known=known[:10], support=support)))


def test_figures_place_the_matrix_as_it_is_written():
    stiffness, damping = figures_of(identification())
    titles = [note.text for note in stiffness.layout.annotations]
    assert titles == [f"k<sub>{place}</sub> in kN/m" for place in ("xx", "xy", "yx", "yy")]
    for place, (k, k_se, c) in enumerate(zip(K.ravel() / 1e3, K_SE.ravel() / 1e3, C.ravel(), strict=True)):
        ml, ls = (panel(stiffness, place)[name] for name in ("ML", "least squares"))
        np.testing.assert_allclose(ml.x, [12.5, 22.5, 32.5])
        np.testing.assert_allclose(ml.y, k)
        np.testing.assert_allclose([ml.error_y.array, ml.error_y.arrayminus], 2 * k_se)
        np.testing.assert_allclose(ls.y, k + 1)
        assert ls.marker.symbol == "x-thin-open"
        np.testing.assert_allclose(panel(damping, place)["ML"].y, c)
    assert not stiffness.layout.shapes


def test_figures_are_hollow_where_unbounded_and_grey_where_refused():
    high = every(K + 2 * K_SE, np.ones(5, bool))
    high[1] = inf
    known = np.array([True, True, False, False, True])
    found = identification(known=known, stiffness_high=high, informative=np.array([True, False, False, False, True]))
    figure, _ = figures_of(found)
    traces = panel(figure, 0)
    hollow = traces["ML, unbounded"]
    assert hollow.marker.symbol == "circle-open" and list(hollow.x) == [22.5]
    assert hollow.y[0] + hollow.error_y.array[0] > figure.layout.yaxis.range[1]
    assert list(traces["ML"].x) == list(traces["least squares"].x[[0, 2]]) == [12.5, 52.5]
    assert {(shape.x0, shape.x1) for shape in figure.layout.shapes} == {(27.5, 47.5)}
    low, top = figure.layout.yaxis.range
    assert low < 129.8 and top > 130.2


def test_one_wide_interval_does_not_flatten_a_panel():
    n = 20
    high = every(K + 2 * K_SE, np.ones(n, bool))
    high[7] = 1e9
    figure, _ = figures_of(identification(known=np.ones(n, bool), stiffness_high=high))
    assert np.ptp(figure.layout.yaxis.range) < 10


def test_refused_everywhere_gives_row_sums_with_the_reason():
    found = identification(known=(False, False, False))
    (figure,) = figures_of(found)
    assert figure.layout.annotations[1].text == "k<sub>yy</sub> + k<sub>yx</sub> / r in kN/m"
    traces = panel(figure, 1)
    assert set(traces) == {"run1.npz", "run2.npz"}
    np.testing.assert_allclose(traces["run1.npz"].y, 119.0)
    np.testing.assert_allclose(traces["run1.npz"].error_y.array, 2.0)
    np.testing.assert_allclose(panel(figure, 2)["run2.npz"].y, 23.0)
    html = page_of(found)
    assert "In every band x and y move along one line" in html and "excitation turned, 90 degrees" in html
    assert "Stiffness of x and y" not in html and "138.0 ±2.0" in html
    assert set(panel(figures_of(found, "a + b + c.npz")[0], 0)) == {"recording 1", "recording 2"}


def test_page_of_a_mixed_result_has_coefficients_and_row_sums():
    html = page_of(identification(known=(True, False), support=True))
    shown = ("8.00 ±0.40", "0.980, 0.970", "one line", "35.00 ±0.20", "k_xx + r k_xy", "In the bands below", "Grey")
    assert [text for text in shown if text not in html] == []
    assert "the rig's support" in html.replace("&#x27;", "'")
    assert "Row sums" not in page_of(identification())


def test_long_tables_of_the_page_are_folded():
    assert page_of(identification(known=np.ones(31, bool))).count("<summary>Table of 31 bands") == 2
    assert "<details>" not in page_of(identification(known=np.ones(30, bool)))


def test_page_escapes_what_users_write():
    html = page_of(identification(known=(True, False), recordings=1), "<script>alert(1)</script>.npz")
    assert "<script>alert" not in html and "one &lt;b&gt;note&lt;/b&gt;" in html


def test_results_without_any_bound_can_be_drawn():
    ends = {f"{name}_{end}": np.full((1, 2, 2), sign * inf)
            for name in ("stiffness", "damping") for end, sign in (("low", -1), ("high", 1))}  # fmt: skip
    found = identification(known=(True,), informative=np.array([False]), **ends)
    assert "ML, unbounded" in page_of(found) and "[-∞, ∞]" in text_of(planar_table(found))


def test_row_sums_are_what_their_headings_say():
    """Motion along y = r x: the force itself, F_x = (k_xx + r k_xy - m w^2 + j w (c_xx + r c_xy)) x, gives the sums."""
    r, mass, f = 0.5, 0.92, np.arange(20.0, 35.0)
    w = 2 * np.pi * f
    motion = 1e-5 * np.exp(1j * f**1.5) * np.array([[1.0], [r]])
    z = K[..., None] - mass * w**2 * np.eye(2)[..., None] + 1j * w * C[..., None]
    force = np.einsum("ijn,jn->in", z, motion)
    noise = np.diag([1e-4, 1e-4, 1e-10, 1e-10])[..., None] ** 2 * np.ones(len(f))
    statistics = LineStatistics(f, f.astype(int), CHANNELS, np.concatenate([force, motion]), noise.astype(complex), 5)
    found = identification(known=(False,), recordings=1)
    sums = row_sums(statistics, np.array([[19.5, 34.5]]), mass)
    table = planar_table(replace(found, row_sums=(sums,)))
    heads = ["".join(column.header.split()[:-1]) for column in table.columns[1:3]]
    assert heads == ["k_xx+rk_xy", "k_yy+k_yx/r"]
    (row,) = cells_of(table)
    values = [float(cell.split()[0]) for cell in row[1:]]
    np.testing.assert_allclose(values, [134.0, 113.0, 21.5, 21.0, 0.5], rtol=2e-3)
