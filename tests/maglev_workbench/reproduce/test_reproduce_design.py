"""The pump's and the bearing's design anew: every published figure, and the formulas as they are printed."""

from functools import cache

import numpy as np
import pytest

from maglev_workbench.commands.reproduce.chapters.bearing.bearing_design import ITEMS
from maglev_workbench.commands.reproduce.chapters.bearing.hydraulics import ITEM
from selfsense.coil import MU_0

TABLE_3_1 = {
    "Axial velocity C_a": (0.656, "m/s"),
    "Straightener outlet angle α₁": (70.24, "°"),
    "Blade velocity U": (4.669, "m/s"),
    "Rotation": (9007.05, "rpm"),
    "Flow coefficient φ": (0.141, ""),
    "Blade loading coefficient ψ": (0.61, ""),
    "Outlet pressure": (99.82, "mmHg"),
    "Blades of the impeller": (9, ""),
    "Blades of straightener and diffuser": (8, ""),
    "Optimised β₁": (77.0, "°"),
    "Optimised α₂": (82.0, "°"),
    "Optimised rotation": (9007.05, "rpm"),
    "Whole-degree β₁": (77.0, "°"),
    "Whole-degree α₂": (82.0, "°"),
}
DIFFERS = {
    "bearing-coefficients": [
        "Stiffness from eq 3.10",
        "Current stiffness from eq 3.10",
        "Measured actuator gain, eq 3.13",
        "Coil inductance, flux through the magnet",
        *["Pull of the coils of two bearings, eq 3.2"] * 2,
    ],
    "stability-conditions": [
        "Eq 3.26, bound of k_d + k_p T_d",
        "Eq 3.26, bound of k_p + k_i T_d",
        *["|k_yy|/k_yi"] * 2,
    ],
}
# Table 3.4, gap from 3.3.1
B_R, L_M, A_M, A_G, I_0, TURNS, GAP = 0.7, 5e-3, 34.715e-6, 39.27e-6, 0.20, 90, 0.35e-3
MU_M = 1.05 * MU_0


@pytest.fixture(scope="module", params=[ITEM, *ITEMS], ids=lambda item: item.name)
def item(request):
    return request.param


@cache
def outcome_of(item):
    return item.run(0)


def rows(item):
    return {(row.name, row.unit): row for row in outcome_of(item).rows}


def found(item, name):
    return [row.found for row in outcome_of(item).rows if row.name == name]


def test_every_item_agrees_where_it_says_so_and_draws(item):
    outcome = outcome_of(item)
    asked = [row for row in outcome.rows if row.within is not None]
    assert asked and [row.name for row in asked if not row.agrees] == DIFFERS.get(item.name, [])
    assert all(row.within <= 0.05 for row in asked)
    assert all(np.isfinite(row.found) for row in outcome.rows)
    assert all(row.agrees is not None or row.reason for row in outcome.rows if row.published is not None)
    assert outcome.notes and all(figure.data for _, figure in outcome.plots)
    assert item.run(1).rows == outcome.rows  # nothing is drawn at random


def test_table_3_1():
    table = rows(ITEM)
    for name, (published, unit) in TABLE_3_1.items():
        row = table[name, unit]
        assert row.published == published and row.within == 0.01
        assert row.found == pytest.approx(published, rel=0.01)
    assert any("13,332" in note for note in outcome_of(ITEM).notes)


def test_the_bearings_coefficients_are_the_printed_equations():
    coefficients, _ = ITEMS
    table = rows(coefficients)
    drive = TURNS * I_0 + B_R * L_M / MU_M
    reluctance = 2 * GAP / MU_0 + L_M * A_G / (MU_M * A_M)
    stiffness = -8 * A_G / MU_0**2 * drive**2 / reluctance**3  # eq 3.12
    gain = 4 * A_G / MU_0 * TURNS * drive / reluctance**2  # eq 3.13
    assert table["Stiffness k_yy, eq 3.12", "N/mm"].found == pytest.approx(1e-3 * stiffness, rel=1e-9)
    assert table["Current stiffness k_yi, eq 3.13", "N/A"].found == pytest.approx(gain, rel=1e-9)
    assert (1e-3 * stiffness, gain) == (pytest.approx(-12.5, rel=0.01), pytest.approx(1.28, rel=0.01))

    def force(y, i):  # eq 3.10
        pulls = (((drive + s * TURNS * i) / (reluctance - s * 2 * y / MU_0)) ** 2 for s in (1, -1))
        upper, lower = pulls
        return A_G / (2 * MU_0) * (upper - lower)

    slope = (force(0, 1e-4) - force(0, -1e-4)) / 2e-4
    assert found(coefficients, "Current stiffness from eq 3.10") == [pytest.approx(slope, rel=1e-6)]
    slope = -(force(1e-8, 0) - force(-1e-8, 0)) / 2e-8
    assert found(coefficients, "Stiffness from eq 3.10") == [pytest.approx(1e-3 * slope, rel=1e-6)]


def test_the_flux_through_the_gaps_gives_the_measured_gain_and_inductance():
    coefficients, _ = ITEMS
    field = B_R * L_M / MU_M / (2 * GAP / MU_0 + L_M * A_G / (MU_M * A_M))
    assert found(coefficients, "Measured actuator gain, flux through the gaps") == [
        pytest.approx(field * TURNS * A_G / GAP, rel=1e-9)
    ]
    assert field * TURNS * A_G / GAP == pytest.approx(5.53, abs=0.005)
    assert found(coefficients, "Coil inductance, flux through the gaps") == [pytest.approx(0.571, abs=5e-4)]
    reluctance = 2 * GAP / (MU_0 * A_G) + L_M / (MU_M * A_M)
    assert found(coefficients, "Coil inductance, flux through the magnet") == [
        pytest.approx(1e3 * TURNS**2 / reluctance, rel=1e-9)
    ]


def test_the_stator_and_its_coils():
    coefficients, _ = ITEMS
    table = rows(coefficients)
    assert table["Core diameter d3, eq 3.1", "mm"].found == pytest.approx(23.8)
    assert table["Core diameter d4, eq 3.1", "mm"].found == pytest.approx(30.8)
    assert table["Height for the winding", "mm"].found == pytest.approx(1.4)
    pulls = found(coefficients, "Pull of the coils of two bearings, eq 3.2")
    assert pulls == [pytest.approx(0.7107, abs=1e-4), pytest.approx(0.0653, abs=1e-4)]


def test_the_stability_conditions():
    _, conditions = ITEMS
    table = rows(conditions)
    assert found(conditions, "|k_yy|/k_yi") == [pytest.approx(9.75, abs=0.005), pytest.approx(2.193, abs=5e-4)]
    bounds = (table["Eq 3.26, bound of k_d + k_p T_d", "A s/mm"], table["Eq 3.26, bound of k_p + k_i T_d", "A/mm"])
    assert [row.found for row in bounds] == [
        pytest.approx(1e-3 * (0.2 / 0.35e-3) * 8.1e-3 / 0.5),
        pytest.approx(1e-3 * (0.2 / 0.35e-3) / 0.5),
    ]
    needed = table["Table 3.5: k_p + k_i T_d", "A/mm"]
    assert needed.found == pytest.approx(8.0002)
    assert needed.reason == "2.19 needed at 5.70 N/A: met; 9.75 needed at 1.28 N/A: not met"
    poles = [row.found for row in outcome_of(conditions).rows if "right-most pole" in row.name]
    assert poles == [pytest.approx(-42.6, abs=0.1), pytest.approx(115.3, abs=0.1)]


def test_the_conditions_miss_the_damping_that_the_loop_needs():
    """Least k_d by a scan of roots of a polynomial multiplied out by hand, against a condition met at 0."""
    _, conditions = ITEMS
    (least,) = found(conditions, "Least k_d with the rest of Table 3.5")
    m, k_yy, k_yi, ta, td, kp, ki = 0.08012, -12.5e3, 5.7, 1e-4, 1e-4, 8e3, 2e3

    def stable(kd):
        p = [
            m * ta * td,
            m * (ta + td),
            m + k_yy * ta * td,
            k_yy * (ta + td) + k_yi * (kd + kp * td),
            k_yy + k_yi * (kp + ki * td),
            k_yi * ki,
        ]
        return np.roots(p).real.max() < 0, min(p) > 0

    assert stable(1001 * least) == (True, True) and stable(999 * least) == (False, True)
    assert stable(0.0) == (False, True)
