"""What the pumped fluid pushes along the axis, which is held passively (3.3.1, 3.4.1): the second point of 7.2."""

from math import inf, pi, tan

import numpy as np

from maglev_env.design.hydraulics import Impeller, Pump, impeller
from maglev_env.rotor.rotor import load_rotor
from maglev_workbench.commands.reproduce.chapter_figures import by_frequency
from maglev_workbench.commands.reproduce.chapters.bearing import hydraulics
from maglev_workbench.commands.reproduce.chapters.bearing.future import FLOWS
from maglev_workbench.commands.reproduce.chapters.bearing.passive_force import TABLE_5_4, Passive, axial_pull
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row, Table

DESIGN = 5.0  # L/min
SHOWN = (0.0, 3.0, 5.0, 7.0, 9.0, 12.0)  # L/min, of the table


def run(_seed: int) -> Outcome:
    """Static pressure by the velocity triangles, and the force of the magnets by the section of flux-map."""
    rotor = load_rotor("pump")
    blades = impeller(hydraulics.PUMP, *hydraulics.PRINTED_ANGLES)
    pressure = static_rise(hydraulics.PUMP, blades, FLOWS)
    bore, whole = (pressure * pi * r**2 for r in (hydraulics.PUMP.tip_radius, rotor.body.radius))
    z, pull = axial_pull(rotor)
    computed = 2 * rotor.axial.stiffness
    measured, table_3_3 = (Passive(z, pull, k) for k in (TABLE_5_4, computed))
    at = int(np.flatnonzero(FLOWS == DESIGN)[0])
    short = float(np.interp(-measured.most, -whole, FLOWS))
    rows = (
        Row("static pressure across the impeller, 5 L/min", None, pressure[at] / 1e3, "kPa", None,
            "Of the 13.3 of Table 3.1; the rest is swirl, which the diffuser turns into pressure."),
        Row("thrust on the rotor, 5 L/min", None, whole[at], "N", None,
            f"On its whole cross-section of 20.3 mm: the fluid stands on both of its ends. On the bore alone "
            f"{bore[at]:.2f} N."),
        Row("largest passive force over that thrust, Table 5.4", "strong enough", measured.most / whole[at], "", None,
            f"3.3.1, 3.4.1. By the stiffness that was measured, which the section of flux-map lets reach "
            f"{measured.most:.2f} N. Against the thrust on the bore alone {measured.most / bore[at]:.1f}. The text "
            "weighs the force against no thrust.", means=(1, inf), kind="prediction"),
        Row("the same, Table 3.3", "strong enough", table_3_3.most / whole[at], "", None,
            f"{computed / 1e3:.1f} kN/m of both bearings, as axial-force reads the table: by what the text computes "
            "the thrust is held, by what it measures it is not.", means=(1, inf), kind="prediction", again="thrust"),
        Row("the same without flow, Table 5.4", "strong enough", measured.most / whole[0], "", None,
            "As at a start against a closed valve: all of the blade velocity then becomes pressure.",
            means=(1, inf), kind="prediction", again="thrust"),
        Row("flow from which the thrust is held, Table 5.4", None, short, "L/min", None, ""),
        Row("displacement by the thrust at 5 L/min, Table 3.3", None, 1e6 * table_3_3.at(whole[at])[0], "µm", None,
            "0.5 mm of clearance are assumed; the passive poles are 2.5 mm wide."),
        Row("axial stiffness there over that without a load", None, table_3_3.at(whole[at])[1], "", None,
            "What 7.2 wants to measure: the stiffness against flow. The force of the magnets bends; the thrust does "
            "not depend on where the rotor is."),
    )  # fmt: skip
    lines = [
        (
            f"{flow:g}",
            f"{pressure[i] / 1e3:.2f}",
            f"{whole[i]:.2f}",
            *(_shown(*passive.at(whole[i])) for passive in (measured, table_3_3)),
        )
        for i, flow in enumerate(FLOWS)
        if flow in SHOWN
    ]
    head = ("flow in L/min", "static pressure in kPa", "thrust in N", "Table 5.4", "Table 3.3")
    table = Table("Thrust, displacement and axial stiffness over that without a load, at 9,007 rpm", head, tuple(lines))
    notes = (
        "Pressures are Euler's on the mean radius, without losses; the shear in the gap and what swirl does to the "
        "pressure on the ends are left out. A thrust of about this size follows from the printed triangles all the "
        "same, and in the air in which the pump was levitated there is none.",
    )
    curves = [
        (name, np.array([passive.at(force)[1] for force in whole]))
        for name, passive in (("Table 5.4", measured), ("Table 3.3", table_3_3))
    ]
    figure = by_frequency(FLOWS, curves, "axial stiffness over that without a load")
    plot = ("Axial stiffness against flow (7.2)", figure.update_xaxes(title_text="flow in L/min"))
    return Outcome(rows, (plot,), notes, (table,))


def static_rise(pump: Pump, blades: Impeller, flows: np.ndarray) -> np.ndarray:
    """Static pressure (Pa) across the impeller at flows (n,) L/min: what the relative velocity loses, by Bernoulli.

    The axial velocity is the same on both sides, and the straightener and the blades' outlet set the swirl.
    """
    axial = pump.axial_velocity * flows * hydraulics.LITRE_PER_MINUTE / pump.flow_rate
    before = blades.blade_velocity - axial * tan(blades.straightener_angle)
    return pump.density / 2 * (before**2 - (axial * tan(pump.outlet_angle)) ** 2)


def _shown(place: float, share: float) -> str:
    return "not held" if np.isnan(place) else f"{1e3 * place:.2f} mm, {share:.2f}"


ITEM = Item("thrust", "The thrust of the pump on its passive axis", "3.3.1, 3.4.1, 7.2; Tables 3.1, 3.3, 5.4", run)
