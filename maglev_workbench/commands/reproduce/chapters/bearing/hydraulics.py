"""Table 3.1: the pump's blade angles, speed and pressure, from the velocity triangles on the mean radius."""

from math import degrees, pi, radians
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.design.hydraulics import (
    MISPRINTS,
    MMHG,
    Impeller,
    Pump,
    blade_number,
    blocked_share,
    impeller,
    least_speed,
    nearest_in_whole_degrees,
    pressure_rise,
)
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row
from maglev_workbench.page import COLOURS, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

TARGET = 100 * MMHG
FLOWS = (3.0, 5.0, 7.0)  # L/min, of the plot
LITRE_PER_MINUTE = 1e-3 / 60
# The outlet angle of the impeller is 0. Five sixths: the factor 1.2 in C_a that the table's digits need.
PUMP = Pump(5 * LITRE_PER_MINUTE, 1003.0, 7.4e-3, 2.5e-3, 0.5e-3, open_fraction=5 / 6)
PRINTED_ANGLES = radians(77.0), radians(82.0)
LIMITS = radians(77.0), radians(85.0)
WITHIN = 0.01


def _run(_seed: int) -> Outcome:
    found = impeller(PUMP, *PRINTED_ANGLES)
    best = least_speed(PUMP, TARGET, *LIMITS)
    whole = nearest_in_whole_degrees(PUMP, TARGET)
    return Outcome(
        rows=(*_table(found), *_optimised(best, whole)),
        plots=(("Pressure of these blades against speed", _pressure_figure(found)),),
        notes=(*MISPRINTS, *_notes(found)),
    )


def _table(found: Impeller) -> tuple[Row, ...]:
    """Rows that follow from the printed dimensions and the two printed angles."""
    blades = blade_number(PUMP.tip_radius, PUMP.hub_radius, PUMP.blade_thickness)
    area = "5 L/min through 5/6 of the annulus: an inferred factor, see the notes"
    mean = "on the mean of hub and tip radius, 4.95 mm: 943.22 rad/s gives 6.98 m/s at the tip"
    angles = (degrees(found.straightener_angle), found.speed * 30 / pi)
    return (
        Row("Axial velocity C_a", 0.656, PUMP.axial_velocity, "m/s", WITHIN, area, kind="fit"),
        Row("Straightener outlet angle α₁", 70.24, angles[0], "°", WITHIN, kind="consequence"),
        Row("Blade velocity U", 4.669, found.blade_velocity, "m/s", WITHIN, mean, kind="consequence"),
        Row("Rotation", 943.22, found.speed, "rad/s", WITHIN, kind="consequence"),
        Row("Rotation", 9007.05, angles[1], "rpm", WITHIN, kind="consequence", again="hydraulics"),
        Row("Flow coefficient φ", 0.141, found.flow_coefficient, "", WITHIN, kind="consequence"),
        Row("Blade loading coefficient ψ", 0.61, found.loading, "", WITHIN, kind="consequence"),
        Row("Outlet pressure", 13309.8, found.pressure, "Pa", WITHIN, kind="consequence"),
        Row(
            "Outlet pressure",
            99.82,
            found.pressure / MMHG,
            "mmHg",
            WITHIN,
            "99.83 with 133.322 Pa per mmHg",
            kind="consequence",
            again="hydraulics",
        ),
        Row("Blades of the impeller", 9, round(blades), "", WITHIN, f"{blades:.2f}, rounded", kind="consequence"),
        Row("Blades of straightener and diffuser", 8, round(blades) - 1, "", WITHIN, kind="consequence"),
    )


def _optimised(best: Impeller, whole: Impeller) -> tuple[Row, ...]:
    """Rows of optimisations that have the printed angles as limits, or that do not use them."""
    slowest = "slowest impeller for 100 mmHg with β₁ up to 77°; the limit is inferred"
    nearest = "of all whole degrees with ψ ≤ 1, the pair nearest to 100 mmHg"
    return (
        Row("Optimised β₁", 77.0, degrees(best.rotor_inlet_angle), "°", WITHIN, slowest, kind="fit"),
        Row("Optimised α₂", 82.0, degrees(best.stator_inlet_angle), "°", WITHIN, slowest, kind="fit"),
        Row(
            "Optimised α₁",
            70.24,
            degrees(best.straightener_angle),
            "°",
            WITHIN,
            slowest,
            kind="fit",
            again="hydraulics",
        ),
        Row(
            "Optimised rotation", 9007.05, best.speed * 30 / pi, "rpm", WITHIN, slowest, kind="fit", again="hydraulics"
        ),
        Row("Optimised pressure", 99.82, best.pressure / MMHG, "mmHg", WITHIN, slowest, kind="fit", again="hydraulics"),
        Row(
            "Whole-degree β₁",
            77.0,
            degrees(whole.rotor_inlet_angle),
            "°",
            WITHIN,
            nearest,
            kind="fit",
            again="hydraulics",
        ),
        Row(
            "Whole-degree α₂",
            82.0,
            degrees(whole.stator_inlet_angle),
            "°",
            WITHIN,
            nearest,
            kind="fit",
            again="hydraulics",
        ),
    )


def _notes(found: Impeller) -> tuple[str, ...]:
    free = least_speed(PUMP, TARGET, radians(82.0), LIMITS[1])
    blocked = blocked_share(9, PUMP.blade_thickness, PRINTED_ANGLES[0], PUMP.mean_radius)
    power = found.pressure * PUMP.flow_rate
    return (
        "The table's objective, the outlet pressure ρ C_a² tan β₁ tan α₂, grows with both angles without end: a search "
        "for its greatest value only returns the limits it was given, and D prints none. Two problems give the printed "
        "angles: the slowest impeller for 100 mmHg with β₁ limited to 77°, and the whole degrees nearest to 100 mmHg.",
        f"Without that limit the slowest impeller has no swirl ahead of it (ψ = 1, α₁ = 0): both angles "
        f"{degrees(free.rotor_inlet_angle):.1f}° and {free.speed * 30 / pi:.0f} rpm for the same pressure.",
        f"Nine blades of 0.5 mm that stand at 77° cover {blocked:.0%} of the circumference at the mean radius; neither "
        "C_a nor the pressure has this in it.",
        f"The pressures are Euler's, without losses, and total: the swirl behind the impeller is part of them. The "
        f"hydraulic power is {power:.2f} W, the torque {1e3 * power / found.speed:.2f} mN m.",
    )


def _pressure_figure(found: Impeller) -> "Figure":
    from plotly.graph_objects import Figure, Scatter

    rpm = np.linspace(4000.0, 14000.0, 101)
    figure = Figure()
    for flow, colour in zip(FLOWS, COLOURS, strict=True):
        rise = pressure_rise(PUMP, found, rpm * pi / 30, flow * LITRE_PER_MINUTE)
        figure.add_trace(Scatter(x=rpm, y=rise / MMHG, name=f"{flow:g} L/min", line={"color": colour}))
    marker = {"color": "black", "size": 10, "symbol": "x"}
    figure.add_trace(Scatter(x=[9007.05], y=[99.82], mode="markers", name="Table 3.1", marker=marker))
    figure.update_xaxes(title="speed in rpm")
    figure.update_yaxes(title="pressure in mmHg")
    return styled(figure, 420)


ITEM = Item("hydraulics", "Blade angles, speed and pressure of the pump", "3.1.3, Table 3.1", _run)
