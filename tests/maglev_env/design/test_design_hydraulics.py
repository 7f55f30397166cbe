"""The pump against Table 3.1, velocity triangles drawn as vectors, and the closed form and a grid of the optimum."""

from dataclasses import replace
from math import atan, degrees, pi, radians, tan

import numpy as np
import pytest

from maglev_env.design.hydraulics import (
    MMHG,
    Pump,
    blade_number,
    blocked_share,
    impeller,
    least_speed,
    nearest_in_whole_degrees,
    pressure_rise,
)

OPEN = Pump(flow_rate=5e-3 / 60, density=1003.0, tip_radius=7.4e-3, hub_radius=2.5e-3, blade_thickness=0.5e-3)
PUMP = replace(OPEN, open_fraction=5 / 6)
PRINTED = impeller(PUMP, radians(77), radians(82))


def test_table_3_1_to_its_last_digit():
    assert PUMP.axial_velocity == pytest.approx(0.656, abs=5e-4)
    assert degrees(PRINTED.straightener_angle) == pytest.approx(70.24, abs=5e-3)
    assert PRINTED.blade_velocity == pytest.approx(4.669, abs=5e-4)
    assert PRINTED.speed == pytest.approx(943.22, abs=5e-3)
    assert PRINTED.speed * 30 / pi == pytest.approx(9007.05, abs=5e-3)
    assert PRINTED.flow_coefficient == pytest.approx(0.141, abs=5e-4)
    assert PRINTED.loading == pytest.approx(0.61, abs=5e-3)
    assert PRINTED.pressure == pytest.approx(13309.8, abs=0.05)
    assert PRINTED.pressure / MMHG == pytest.approx(99.82, rel=2e-4)
    assert round(blade_number(7.4e-3, 2.5e-3, 0.5e-3)) == 9


def test_the_open_annulus_and_nine_blades_across_it_give_another_axial_velocity():
    assert OPEN.axial_velocity == pytest.approx(0.5468, abs=1e-4)
    bladed = replace(OPEN, open_fraction=1 - blocked_share(9, 0.5e-3, 0.0, OPEN.mean_radius))
    assert bladed.axial_velocity == pytest.approx(0.6393, abs=1e-4)


def test_slanted_blades_block_what_their_section_covers():
    """Share of points on the unrolled circumference that lie in a strip of a thickness across its own direction."""
    around = 2 * pi * PUMP.mean_radius
    pitch, angle = around / 9, radians(60)
    x = (np.arange(200_000) + 0.5) / 200_000 * pitch
    inside = np.abs((x - pitch / 2) * np.cos(angle)) < 0.25e-3
    assert blocked_share(9, 0.5e-3, angle, PUMP.mean_radius) == pytest.approx(inside.mean(), rel=1e-3)


@pytest.mark.parametrize("outlet", [0.0, 30.0, -20.0])
def test_the_triangles_close_and_give_eulers_pressure(outlet):
    pump = replace(PUMP, outlet_angle=radians(outlet))
    found = impeller(pump, radians(70), radians(78))
    ca, u = pump.axial_velocity, found.speed * pump.mean_radius
    swirl_in, swirl_out = ca * tan(found.straightener_angle), ca * tan(radians(78))
    assert np.degrees(np.arctan2(u - swirl_in, ca)) == pytest.approx(70)
    assert np.degrees(np.arctan2(u - swirl_out, ca)) == pytest.approx(outlet)
    torque = pump.density * pump.flow_rate * pump.mean_radius * (swirl_out - swirl_in)
    assert found.pressure * pump.flow_rate == pytest.approx(torque * found.speed)
    assert found.loading == pytest.approx(found.pressure / (pump.density * u**2))
    assert found.flow_coefficient == pytest.approx(ca / u)


def test_at_its_design_point_the_fixed_blades_give_the_design_pressure():
    for pump in (PUMP, replace(PUMP, outlet_angle=0.3)):
        design = impeller(pump, radians(70), radians(78))
        assert pressure_rise(pump, design, design.speed, pump.flow_rate) == pytest.approx(design.pressure)
        # at a proportional flow the triangles are similar
        halved = pressure_rise(pump, design, design.speed / 2, pump.flow_rate / 2)
        assert halved == pytest.approx(design.pressure / 4)


def test_the_slowest_impeller_is_the_closed_form_and_beats_a_grid():
    target, limit = 100 * MMHG, radians(77)
    found = least_speed(PUMP, target, limit, radians(85))
    ca = PUMP.axial_velocity
    assert found.rotor_inlet_angle == pytest.approx(limit)
    assert found.stator_inlet_angle == pytest.approx(atan(target / (1003 * ca**2 * tan(limit))), rel=1e-9)
    grid = [impeller(PUMP, b, a) for b in np.linspace(0.5, limit, 80) for a in np.linspace(0.5, radians(85), 80)]
    fastest = min(i.speed for i in grid if i.pressure >= target and i.loading <= 1)
    assert found.speed <= fastest < 1.05 * found.speed
    for name in ("stator_inlet_angle", "straightener_angle", "blade_velocity", "speed", "pressure", "loading"):
        assert getattr(found, name) == pytest.approx(getattr(PRINTED, name), rel=0.01)


def test_a_higher_limit_ends_at_an_impeller_without_swirl_ahead_of_it():
    found = least_speed(PUMP, 100 * MMHG, radians(82), radians(85))
    assert found.loading == pytest.approx(1.0, abs=1e-9)
    assert tan(found.stator_inlet_angle) == pytest.approx(np.sqrt(100 * MMHG / 1003) / PUMP.axial_velocity, rel=1e-7)


def test_the_printed_angles_are_the_whole_degrees_nearest_100_mmhg():
    best = nearest_in_whole_degrees(PUMP, 100 * MMHG)
    assert (degrees(best.rotor_inlet_angle), degrees(best.stator_inlet_angle)) == (pytest.approx(77), pytest.approx(82))


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="raise rotor_inlet_limit"):
        least_speed(PUMP, 100 * MMHG, radians(77), radians(82))
    with pytest.raises(ValueError, match="loaded above 1"):
        least_speed(PUMP, 100 * MMHG, radians(84), radians(80))
    with pytest.raises(ValueError, match="give radians"):
        impeller(PUMP, 77.0, 82.0)
    with pytest.raises(ValueError, match="hub_radius"):
        replace(PUMP, hub_radius=8e-3)
    with pytest.raises(ValueError, match="open_fraction"):
        replace(PUMP, open_fraction=1.2)
    with pytest.raises(ValueError, match="flow_rate"):
        replace(PUMP, flow_rate=0.0)
    with pytest.raises(ValueError, match="outlet_angle"):
        replace(PUMP, outlet_angle=45.0)


def test_whole_degrees_never_swirl_against_the_rotation():
    """With blades that lean forward at the outlet, loads above 1 come nearer to some pressures."""
    pump, angles, decided = replace(PUMP, outlet_angle=radians(-30)), np.arange(1, 90), 0
    turned = np.tan(np.radians(angles))[:, None] - tan(pump.outlet_angle)
    around = np.tan(np.radians(angles)) + tan(pump.outlet_angle)
    for target in np.array([40.0, 80.0, 100.0, 160.0]) * MMHG:
        off = np.where(around > 0, np.abs(1003 * pump.axial_velocity**2 * turned * around - target), np.inf)
        allowed = np.where(turned <= around, off, np.inf)
        b, a = np.unravel_index(allowed.argmin(), off.shape)
        best = nearest_in_whole_degrees(pump, target)
        assert (best.rotor_inlet_angle, best.stator_inlet_angle) == pytest.approx(np.radians([angles[b], angles[a]]))
        decided += allowed.min() > off.min()
    assert decided == 3


@pytest.mark.parametrize("outlet", [-50.0, -20.0, 40.0])
def test_the_slowest_impeller_with_blades_that_lean_at_the_outlet(outlet):
    pump, limit = replace(PUMP, outlet_angle=radians(outlet)), radians(75)
    found = least_speed(pump, 100 * MMHG, limit, radians(86))
    turned = tan(limit) - tan(pump.outlet_angle)
    assert found.loading < 1
    assert found.blade_velocity == pytest.approx(100 * MMHG / (1003 * pump.axial_velocity * turned), rel=1e-7)
