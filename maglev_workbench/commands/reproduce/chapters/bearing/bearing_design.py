"""Section 3.3-3.4 of the dissertation: the hybrid bearing's coefficients, and the stability conditions of its gains."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from maglev_env.design.pid_rules import ControlledAxis, rightmost_pole, stability_conditions
from maglev_env.design.stator import StatorSection, attraction
from maglev_env.loop.gains import Gains
from maglev_env.loop.magnets.kinds import geometric_law, inductance
from maglev_env.loop.magnets.law import ForceLaw, linearise
from maglev_env.rig.rig import Rig, with_parameters
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row
from maglev_workbench.page import COLOURS, labelled_axis, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

STATOR = StatorSection(
    inner_diameter=21e-3, outer_diameter=35.6e-3, core_thickness=3.5e-3, wire_diameter=0.15e-3, coil_length=5e-3
)
PRINTED_STIFFNESS, PRINTED_GAIN = -12.5, 1.28  # N/mm, N/A (eq 3.14)
MEASURED_GAIN, MEASURED_INDUCTANCE = 5.7, 0.57  # N/A (5.2.3), mH (3.3.2)
MEASURED_OVER_ECCENTRICITY = ((0.0, 5.8), (0.2, 5.7), (0.5, 4.1))  # share of the gap, N/V at 1 A/V (5.2.3.2)
PRINTED_TD, PRINTED_SENSOR_GAIN = 8e-3, 0.5  # s, of eq 3.26; A_s of eq 3.20
PRINTED_BOUNDS = 3.13e-4, 0.04  # eq 3.26, no units
POLE_RANGE = [-250.0, 400.0]  # 1/s, of the plots
WITHIN = 0.01


def _pair(rig: Rig, flux_path: str) -> tuple[Rig, ForceLaw]:
    """The law of one pair of opposed magnets by its geometry, eq 3.10, for a path of the control flux."""
    raw = {"actuator_gain": None, "negative_stiffness": None, "flux_path": flux_path, "bearings": 1}
    one = with_parameters(rig, raw)
    return one, geometric_law(one)


def _coefficients(_seed: int) -> Outcome:
    rig = load_rig("hmb_free")
    (one, magnet), (_, gap) = _pair(rig, "magnet"), _pair(rig, "gap")
    gain, stiffness = linearise(magnet)
    field = magnet.magnet_flux / (magnet.gap + magnet.magnet_gap)
    gap_gain = field * rig.turns * rig.pole_area / rig.gap
    near = magnet.magnet_flux / (0.5 * magnet.gap + magnet.magnet_gap)
    gap_inductance = 1e3 * inductance(one)
    through_magnet = gap_inductance * rig.gap / (rig.gap + magnet.magnet_gap)
    twice = "eq 3.12, 3.13 as printed: twice the derivative of 3.10"
    once = "the derivative of eq 3.10: half of what 3.12, 3.13 print, see the notes"
    path = (
        "B_0 N A_g / g_0, control flux through the air gaps alone; eq 3.9 sends it through the magnet too. Of two "
        "ways to count the faces this is the one that agrees, see the notes"
    )
    rows = (
        Row("Stiffness k_yy, eq 3.12", PRINTED_STIFFNESS, 2e-3 * stiffness, "N/mm", WITHIN, twice, kind="consequence"),
        Row("Current stiffness k_yi, eq 3.13", PRINTED_GAIN, 2 * gain, "N/A", WITHIN, twice, kind="consequence"),
        Row(
            "Stiffness from eq 3.10",
            PRINTED_STIFFNESS,
            1e-3 * stiffness,
            "N/mm",
            WITHIN,
            once,
            kind="consequence",
            again="bearing-coefficients",
        ),
        Row(
            "Current stiffness from eq 3.10",
            PRINTED_GAIN,
            gain,
            "N/A",
            WITHIN,
            once,
            kind="consequence",
            again="bearing-coefficients",
        ),
        Row("Bias field B_0 of the magnet", None, field, "T"),
        Row(
            "Measured actuator gain, flux through the gaps",
            MEASURED_GAIN,
            gap_gain,
            "N/A",
            0.05,
            path,
            kind="fit",
            again="actuator-gain",
        ),
        Row(
            "Measured actuator gain, eq 3.13",
            MEASURED_GAIN,
            2 * gain,
            "N/A",
            0.05,
            "the wrong flux path: 4.5 times",
            kind="consequence",
            again="actuator-gain",
        ),
        Row(
            "Coil inductance, flux through the gaps",
            MEASURED_INDUCTANCE,
            gap_inductance,
            "mH",
            WITHIN,
            "μ₀N²A_g/2g₀",
            kind="fit",
        ),
        Row(
            "Coil inductance, flux through the magnet",
            MEASURED_INDUCTANCE,
            through_magnet,
            "mH",
            WITHIN,
            "as eq 3.9",
            kind="consequence",
            again="bearing-coefficients",
        ),
        *_stator_rows(rig),
    )
    gains = linearise(gap)[0]
    notes = (
        "Eqs 3.12 and 3.13 are exactly twice the derivatives of eq 3.10. Eq 3.8 counts one pole face per magnet, "
        "B² A_g / (2 μ₀) each, and eq 3.2 both; two faces or two bearings each give the factor, and D names neither.",
        f"The control flux decides the gain: with the magnet's reluctance, that of {1e3 * magnet.magnet_gap:.2f} mm of "
        f"air per gap, in its way a coil gives {2 * gain:.2f} N/A and {through_magnet:.3f} mH; through the gaps alone "
        f"{gap_gain:.2f} N/A and {gap_inductance:.3f} mH. The measured inductance, 0.57 mH, decides for the latter.",
        f"5.53 N/A counts one pair and one face per magnet, as eq 3.10 does, and the magnet's field alone; with the "
        f"0.2 A of bias current it is {gains:.2f} N/A. By the count of eqs 3.12 and 3.13 it would be "
        f"{2 * gap_gain:.1f} N/A, and D does not say which count its measurement has. The inductance does not depend "
        "on it.",
        f"The gain of either path rises with eccentricity; the measured one falls from 20 % on. Saturated iron would "
        f"do that, but at 50 % the magnet's field on the near side is only {near:.2f} T: what does it is open.",
    )
    return Outcome(rows, (("Actuator gain against eccentricity", _eccentricity_figure(magnet, gap)),), notes)


def _stator_rows(rig: Rig) -> tuple[Row, ...]:
    pulls = {n: attraction(n, rig.bias_current, rig.gap, rig.pole_area, bearings=2) for n in (STATOR.turns, rig.turns)}
    needed = STATOR.turns * (0.52 / pulls[STATOR.turns]) ** 0.5
    planned = f"with the {STATOR.turns} turns that fit; 0.52 N would need {needed:.0f}"
    wound = f"with the {rig.turns:g} turns wound; the 80.12 g rotor weighs {rig.mass * rig.gravity:.2f} N, not 0.51"
    return (
        Row("Core diameter d3, eq 3.1", 23.8, 1e3 * STATOR.core_inner_diameter, "mm", WITHIN, kind="consequence"),
        Row("Core diameter d4, eq 3.1", 30.8, 1e3 * STATOR.core_outer_diameter, "mm", WITHIN, kind="consequence"),
        Row("Height for the winding", 1.4, 1e3 * STATOR.window_height, "mm", WITHIN, kind="consequence"),
        Row("Turns that fit", 297, STATOR.turns, "", WITHIN, "90 were wound (3.3.2)", kind="consequence"),
        Row(
            "Pull of the coils of two bearings, eq 3.2",
            0.52,
            pulls[STATOR.turns],
            "N",
            WITHIN,
            planned,
            kind="consequence",
        ),
        Row(
            "Pull of the coils of two bearings, eq 3.2",
            0.52,
            pulls[rig.turns],
            "N",
            WITHIN,
            wound,
            kind="consequence",
            again="bearing-coefficients",
        ),
    )


def _conditions(_seed: int) -> Outcome:
    rig = load_rig("hmb_free")
    gains = rig.gains
    measured = ControlledAxis(rig.mass, rig.negative_stiffness, rig.actuator_gain, rig.amplifier_time_constant)
    _, law = _pair(rig, "magnet")
    nominal_gain, nominal_stiffness = (2 * value for value in linearise(law))
    nominal = replace(measured, negative_stiffness=nominal_stiffness, actuator_gain=nominal_gain)
    printed_ratio = rig.bias_current / rig.gap
    time, damping, stiffness, _ = stability_conditions(measured, gains)
    rows = (
        *_bound_rows(measured, gains, printed_ratio),
        _ratio_row(printed_ratio, nominal, f"with k_yi {nominal_gain:.2f} N/A and k_yy of eq 3.14: not I₀/g₀"),
        _ratio_row(
            printed_ratio,
            measured,
            "with the measured 5.7 N/A: not I₀/g₀, which holds without a magnet only",
            again="stability-conditions",
        ),
        Row("m/|k_yy|, above T_a T_d", None, 1e6 * time.value, "1e-6 s²", reason=f"above {1e6 * time.bound:.2g}"),
        Row("Table 3.5: k_p + k_i T_d", None, 1e-3 * stiffness.value, "A/mm", reason=_needed(measured, nominal, gains)),
        Row(
            "Table 3.5: k_d + k_p T_d", None, 1e-3 * damping.value, "A s/mm", None, f"above {1e-3 * damping.bound:.2g}"
        ),
        _pole_row("5.7 N/A", measured, gains, "levitates: a slow real pole of the leaking integrator"),
        _pole_row(f"{nominal_gain:.2f} N/A", nominal, gains, "does not levitate, as the corrected condition says"),
        *_border_rows(measured, gains),
    )
    notes = (
        "The conditions of eq 3.25 are three of the six coefficients of eq 3.24 above 0; I₀/g₀ in them is |k_yy|/k_yi "
        "of electromagnets without a permanent magnet. With the magnet's bias the ratio itself has to stand there. "
        f"The printed one, {1e-3 * printed_ratio:.2f} A/mm, passes gains that cannot hold the rotor.",
        "Positive coefficients are necessary and, for a polynomial of order five, not sufficient: Table 3.5 with "
        "k_d = 0 meets all of them and is unstable, and so are gains too high. Routh's array or the roots decide. "
        "k_i > 0 belongs to the conditions too.",
        "Eq 3.26 takes T_d = 8 ms; Table 3.5 has 0.1 ms. Its two bounds have the ratio T_a + T_d = 7.8 ms, so they "
        "follow from 8 ms and one rounded I₀/(g₀ A_s α_a) of 0.0386; no printed I₀, g₀ and A_s give that number.",
        "Eq 3.21's integrator is ideal, that of eq 3.27 leaks: the poles here are those of 3.27, the conditions those "
        "of 3.21, neither with the probe's lag nor the controller's delay.",
    )
    plots = (
        ("Right-most pole against k_p", _pole_figure("kp", np.geomspace(4e2, 6e4, 300), measured, nominal, gains)),
        ("Right-most pole against k_d", _pole_figure("kd", np.linspace(0.0, 15.0, 301), measured, nominal, gains)),
    )
    return Outcome(rows, plots, notes)


def _bound_rows(axis: ControlledAxis, gains: Gains, ratio: float) -> tuple[Row, Row, Row]:
    """Rows that derive eq 3.26 from 3.25 with the printed symbols."""
    slow = replace(axis, loop_gain=PRINTED_SENSOR_GAIN)
    _, damping, stiffness, _ = stability_conditions(slow, replace(gains, td=PRINTED_TD), ratio)
    quotient = PRINTED_BOUNDS[0] / PRINTED_BOUNDS[1]
    implied = f"I₀/g₀ = {1e-3 * ratio:.3f} A/mm and A_s = 0.5 as printed; 0.04 needs A_s α_a of about 14 V/mm A/V"
    return (
        Row(
            "Eq 3.26, bound of k_d + k_p T_d",
            PRINTED_BOUNDS[0],
            1e-3 * damping.bound,
            "A s/mm",
            0.05,
            implied,
            kind="consequence",
        ),
        Row(
            "Eq 3.26, bound of k_p + k_i T_d",
            PRINTED_BOUNDS[1],
            1e-3 * stiffness.bound,
            "A/mm",
            0.05,
            implied,
            kind="consequence",
        ),
        Row(
            "T_a + T_d, ratio of the two bounds",
            1e3 * quotient,
            1e3 * damping.bound / stiffness.bound,
            "ms",
            0.05,
            kind="consequence",
        ),
    )


def _ratio_row(printed: float, axis: ControlledAxis, reason: str, again: str = "") -> Row:
    found = 1e-3 * axis.current_per_displacement
    return Row("|k_yy|/k_yi", round(1e-3 * printed, 3), found, "A/mm", 0.05, reason, kind="consequence", again=again)


def _needed(measured: ControlledAxis, nominal: ControlledAxis, gains: Gains) -> str:
    parts = []
    for axis in (measured, nominal):
        condition = stability_conditions(axis, gains)[2]
        met = "met" if condition.met else "not met"
        parts.append(f"{1e-3 * condition.bound:.2f} needed at {axis.actuator_gain:.2f} N/A: {met}")
    return "; ".join(parts)


def _pole_row(name: str, axis: ControlledAxis, gains: Gains, reason: str) -> Row:
    return Row(
        f"Table 3.5, eq 3.27: right-most pole at {name}", None, rightmost_pole(axis, gains, True), "1/s", None, reason
    )


def _border_rows(axis: ControlledAxis, gains: Gains) -> tuple[Row, Row]:
    """Rows that compare the gains at which the loop of eq 3.21 becomes unstable with the corrected conditions."""
    _, damping, stiffness, _ = stability_conditions(axis, gains)
    lowest = (stiffness.bound - gains.ki * gains.td, damping.bound - gains.kp * gains.td)
    kp = _border(axis, lambda v: replace(gains, kp=v), 0.5 * lowest[0], gains.kp)
    kd = _border(axis, lambda v: replace(gains, kd=v), 0.0, gains.kd)
    reason = "least stable value of eq 3.21 by its roots; the corrected condition asks for more than {:.3g} only".format
    rest = "with the rest of Table 3.5"
    return (
        Row(f"Least k_p {rest}", None, 1e-3 * kp, "A/mm", None, reason(1e-3 * lowest[0])),
        Row(f"Least k_d {rest}", None, 1e-3 * kd, "A s/mm", None, reason(1e-3 * lowest[1])),
    )


def _border(axis: ControlledAxis, changed: Callable[[float], Gains], low: float, high: float) -> float:
    return float(scipy.optimize.brentq(lambda v: rightmost_pole(axis, changed(v)), low, high))


def _eccentricity_figure(magnet: ForceLaw, gap: ForceLaw) -> "Figure":
    from plotly.graph_objects import Figure, Scatter

    share = np.linspace(0.0, 0.5, 51)
    figure = Figure()
    for name, law, factor, colour in (
        ("flux through the gaps, eq 3.10", gap, 1.0, COLOURS[2]),
        ("flux through the magnet, eq 3.13", magnet, 2.0, COLOURS[1]),
    ):
        gains = [factor * linearise(law, x * law.gap)[0] for x in share]
        figure.add_trace(Scatter(x=100 * share, y=gains, name=name, line={"color": colour}))
    x, y = zip(*MEASURED_OVER_ECCENTRICITY, strict=True)
    marker = {"color": "black", "size": 9}
    figure.add_trace(Scatter(x=[100 * v for v in x], y=y, mode="markers", name="measured (5.2.3.2)", marker=marker))
    figure.update_xaxes(title="eccentricity in % of the gap")
    figure.update_yaxes(title="actuator gain in N/A", rangemode="tozero")
    return styled(figure, 420)


def _pole_figure(
    name: str, values: np.ndarray, measured: ControlledAxis, nominal: ControlledAxis, gains: Gains
) -> "Figure":
    """Right-most pole over one gain for both actuator gains, with the limits by the conditions."""
    from plotly.graph_objects import Figure, Scatter

    figure, shown, marks = Figure(), 1e-3 * values, [("Table 3.5", getattr(gains, name), "black")]
    for axis, colour in ((measured, COLOURS[0]), (nominal, COLOURS[1])):
        poles = [rightmost_pole(axis, replace(gains, **{name: float(v)}), True) for v in values]
        label = f"{axis.actuator_gain:.2f} N/A"
        figure.add_trace(Scatter(x=shown, y=poles, name=label, line={"color": colour}))
        if name == "kp":
            marks.append((f"|k_yy|/k_yi at {label}", axis.current_per_displacement, colour))
    for label, x, colour in marks:  # as traces: a logarithmic axis misplaces plotly's vertical lines
        line = {"color": colour, "dash": "dot" if colour == "black" else "dash"}
        figure.add_trace(Scatter(x=[1e-3 * x] * 2, y=POLE_RANGE, mode="lines", name=label, line=line))
    figure.add_hline(0.0, line={"color": "#666", "width": 1})
    figure.update_xaxes(**labelled_axis(f"{name} in {'A/mm' if name == 'kp' else 'A s/mm'}", shown, name == "kp"))
    figure.update_yaxes(title="right-most pole in 1/s", range=POLE_RANGE)
    return styled(figure, 420)


ITEMS = (
    Item("bearing-coefficients", "Coefficients of the hybrid bearing", "3.3.1, 3.4.2, eq 3.9-3.14", _coefficients),
    Item(
        "stability-conditions", "Stability conditions of the PID gains", "3.4.2, eq 3.21-3.27, Table 3.5", _conditions
    ),
)
