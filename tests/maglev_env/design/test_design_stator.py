"""The stator's section against the printed dimensions, and the coils' pull against the energy in the gap."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.design.stator import StatorSection, attraction
from selfsense.coil import MU_0

PRINTED = StatorSection(
    inner_diameter=21e-3, outer_diameter=35.6e-3, core_thickness=3.5e-3, wire_diameter=0.15e-3, coil_length=5e-3
)
GAP, AREA = 0.35e-3, 39.27e-6


def test_the_printed_section():
    assert PRINTED.core_inner_diameter == pytest.approx(23.8e-3)
    assert PRINTED.core_outer_diameter == pytest.approx(30.8e-3)
    assert PRINTED.window_height == pytest.approx(1.4e-3)
    assert (PRINTED.turns_per_layer, PRINTED.layers, PRINTED.turns) == (9, 33, 297)


def test_the_core_lies_centred_between_bore_and_bolts():
    section = replace(PRINTED, core_thickness=2.7e-3, outer_diameter=40e-3)
    outside = (section.hole_circle - section.core_outer_diameter) / 2
    assert outside == pytest.approx(section.window_height)
    assert (section.core_outer_diameter - section.core_inner_diameter) / 2 == pytest.approx(2.7e-3)


def test_a_window_of_exactly_nine_wires_holds_nine():
    for wire in (1.4e-3 / 9, 1.4e-3 / 7):
        assert replace(PRINTED, wire_diameter=wire).turns_per_layer == round(1.4e-3 / wire)


def test_a_core_too_thin_or_too_thick_is_refused():
    for thickness in (1.9e-3, 6.4e-3):
        with pytest.raises(ValueError, match="core_thickness"):
            replace(PRINTED, core_thickness=thickness)
    with pytest.raises(ValueError, match="wire_diameter"):
        replace(PRINTED, wire_diameter=0.0)


def test_the_pull_is_the_slope_of_the_energy():
    """Force = d/dg of L(g) I^2 / 2 at constant current, L = mu_0 N^2 A / (2 g), by central differences."""
    step = 1e-6 * GAP
    energy = [MU_0 * 90**2 * AREA / (2 * g) * 0.2**2 / 2 for g in (GAP - step, GAP + step)]
    assert attraction(90, 0.2, GAP, AREA) == pytest.approx((energy[0] - energy[1]) / (2 * step), rel=1e-8)


def test_no_turns_of_the_dissertation_give_its_pull():
    """0.52 N of two bearings: 297 turns give 0.71, the 90 wound 0.065; 254 would be needed."""
    assert attraction(297, 0.2, GAP, AREA, bearings=2) == pytest.approx(0.7107, abs=1e-4)
    assert attraction(90, 0.2, GAP, AREA, bearings=2) == pytest.approx(0.0653, abs=1e-4)
    needed = 297 * np.sqrt(0.52 / attraction(297, 0.2, GAP, AREA, bearings=2))
    assert needed == pytest.approx(254.05, abs=0.01)
    with pytest.raises(ValueError, match="gap"):
        attraction(90, 0.2, 0.0, AREA)
