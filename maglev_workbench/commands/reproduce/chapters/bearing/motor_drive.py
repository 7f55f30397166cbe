"""Section 3.3.4: the torque of the motor by its coil sides (eq 3.3-3.6), and with the drive that was used (3.4.3)."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_env.rotor.rotor import load_rotor
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row
from maglev_workbench.page import COLOURS, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

# Coil sides in 24ths of pi and their signs, eq 3.5, for U, W and V.
SIDES = (((-3, 1), (3, -1), (21, 1), (27, -1)), ((5, 1), (11, -1), (29, 1), (35, -1)),
         ((13, 1), (19, -1), (37, 1), (43, -1)))  # fmt: skip
PRINTED_LIMIT = 21  # 24ths of pi: the integral of eq 3.6 runs from -7/8 to 7/8 pi
PHASES = np.deg2rad([-60.0, 0.0, 35.0])


def run(_seed: int) -> Outcome:
    """Torque over a turn with the currents of eq 3.4, and with the six steps of a drive that senses zero crossings."""
    angle = np.linspace(0, 2 * np.pi, 721)  # w t
    sine = np.array([torque(angle, currents(angle, phi)) for phi in PHASES])
    closed = 6 * np.cos(PHASES)
    printed = torque(angle, currents(angle, 0.0), PRINTED_LIMIT)
    steps = torque(angle, six_steps(angle))
    ripple = np.ptp(sine, axis=1) / np.abs(sine.mean(axis=1))
    motor, w = load_rotor("pump").motor, 10_000 * np.pi / 30
    rows = (
        Row("torque of all coil sides over 6 N r l A B cos(phi), size", 1.0,
            float(np.mean(np.abs(sine.mean(axis=1) / closed))), "", 1e-6, "Eq 3.3 to 3.5, term by term.",
            kind="consequence"),
        Row("the same by the integral as printed, twice from -7/8 to 7/8 pi", 1.0,
            float(np.abs(2 * printed.mean()) / 6), "", 1e-6,
            "With the sides where eq 3.5 prints them, six lie inside: half of the twelve.",
            kind="consequence", again="motor"),
        Row("the same, sign", None, float(np.sign(sine[1].mean())), "", None,
            "By the minus of eq 3.3. It is the force on the coils; the rotor has the opposite, as eq 3.6 prints it."),
        Row("ripple of the torque over position, eq 3.4's currents", "independent of position", float(ripple.max()),
            "", None, "Peak to peak over the mean.", means=(0, 1e-9), kind="consequence"),
        Row("the same with six steps of 120 degrees", "independent of position", float(np.ptp(steps) / steps.mean()),
            "", None, "A drive that waits for a phase's zero crossing (3.4.3) leaves that phase without current: two "
            "phases carry, and the torque follows cos over 60 degrees.", means=(0, 0.05), kind="prediction"),
        Row("torque of six steps over that of sines with the same peak", None, float(steps.mean() / 6), "", None,
            "6 sqrt(3) / pi over 3: more torque from the same current."),
        Row("torque that 5.2 W at 10,000 rpm leaves at most", None, 5.2 / w * 1e3, "mN m", None,
            "If all of the motor's power turned the rotor in air. The pump's hydraulic torque is 1.18 mN m "
            "(hydraulics)."),
        Row("current for it, assumed field of 0.45 T", None, 5.2 / w / motor.torque_constant, "A", None,
            "21 turns; radius, length and field are not published (Table 3.2 has names only)."),
    )  # fmt: skip
    return Outcome(rows, (("Torque over an electrical turn", _figure(angle, sine[1], steps)),))


def currents(angle: np.ndarray, phi: float) -> np.ndarray:
    """Eq 3.4 for A = 1 (3, n)."""
    return np.cos(angle + phi + 2 * np.pi / 3 * np.arange(3)[:, None])


def six_steps(angle: np.ndarray) -> np.ndarray:
    """Currents (3, n) of 1, 0 and -1 against the field at each phase, for a positive torque: sign of the larger two."""
    wave = -np.cos(angle + 2 * np.pi / 3 * np.arange(3)[:, None])
    return np.where(np.abs(wave) > 0.5, np.sign(wave), 0.0)


def torque(angle: np.ndarray, current: np.ndarray, limit: int | None = None) -> np.ndarray:
    """Torque (n,) over N r l B: the field of eq 3.3 at each side of eq 3.5 times its current.

    limit: sides up to this angle, in 24ths of pi, from -limit on and without its ends; None: all.
    """
    total = np.zeros(len(angle))
    for sides, i in zip(SIDES, current, strict=True):
        for place, sign in sides:
            if limit is None or abs(place) < limit:
                total -= np.sin(angle - 4 * np.pi * place / 24) * sign * i
    return total


def _figure(angle: np.ndarray, sine: np.ndarray, steps: np.ndarray) -> "Figure":
    from plotly.graph_objects import Figure

    figure = Figure()
    for (name, values), colour in zip((("sines, eq 3.4", np.abs(sine)), ("six steps", steps)), COLOURS, strict=False):
        figure.add_scatter(x=np.degrees(angle), y=values, name=name, line={"color": colour})
    figure.update_xaxes(title_text="electrical angle in degrees")
    figure.update_yaxes(title_text="torque over N r l A B", rangemode="tozero")
    return styled(figure, 400)


ITEM = Item("motor", "The torque of the motor", "Section 3.3.4, eq 3.3-3.6, Table 3.2; 3.4.3", run)
