"""What eddy currents in laminations of 0.23 mm do: Figures 5.20, 5.22, 5.23 and 6.17 put effects down to them."""

from math import inf

import numpy as np

from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.reproduce.chapter_figures import by_frequency
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row
from selfsense.coil import MU_0

THICKNESS = 0.23e-3  # m (3.3.2, Table 4.1)
SOLID = 2.5e-3  # m: a ring as wide as the poles, of one piece
RESISTIVITY = 0.5e-6  # ohm m, of silicon iron
PERMEABILITIES = (1000.0, 5000.0, 20000.0)  # relative, of it
IRON = 60e-3  # m of iron in a bearing's loop, assumed
E_FRAME_IRON = 0.15  # m, assumed: arms of 13 mm
TURNING = 8000.0 / 60  # Hz (5.3.4)
POLES = 4  # past which a point of the rotor turns
HIGHEST = 250.0  # Hz, of the excitation
PERIOD = 40e-6  # s, of switching
SOON = 1e-6  # s: within what an oscillogram of some periods shows as a vertical step
SENSOR = 150e3  # Hz, bandwidth of the current sensor (6.4.1.1)
STEEP = 2.0  # times the triangle's own slope from which a flank is no part of the triangle to the eye


def run(_seed: int) -> Outcome:
    """Flux density over a lamination's thickness by diffusion, in a magnetic circuit with its air gaps."""
    free, frame = load_rig("hmb_free"), load_rig("eframe")
    passing = POLES * TURNING
    lost = [100 * (1 - abs(gain(free, passing, mu))) for mu in PERMEABILITIES]
    solid = [100 * (1 - abs(gain(free, passing, mu, SOLID))) for mu in PERMEABILITIES]
    at_top = [gain(free, HIGHEST, mu) for mu in PERMEABILITIES]
    worst = 100 * max(1 - abs(g) for g in at_top)
    late = max(-np.degrees(np.angle(g)) for g in at_top)
    corners = [corner(frame, mu) for mu in PERMEABILITIES[:2]]
    steep = steepest(frame, PERMEABILITIES[0], SENSOR)
    rows = (
        Row("force lost as the rotor turns at 8,000 rpm", "negligible skin effect", max(lost), "%", None,
            f"A point of a ring passes {POLES} poles per turn, {passing:.0f} Hz; the largest of three permeabilities. "
            "As published.", means=(0, 1), kind="prediction"),
        Row("the same of solid rings", None, max(solid), "%", None,
            f"{min(solid):.2g} to {max(solid):.2g} % for rings of one piece, though the gaps keep most of the flux: "
            "identifying at rest and at speed would have shown them."),
        Row("actuator gain lost at 250 Hz", "hides the effect of k_p", worst, "%", None,
            "5.3.3 puts it down to eddy currents and hysteresis that k_p no longer shows from 130 to 250 Hz. To hide a "
            "step of k_p by 22 % they would have to take at least 5 %. What noise hides: proportional-gain.",
            means=(5, 100), kind="prediction"),
        Row("lag of the force at 250 Hz", "lowers the goodness of fit", late, "°", None,
            "5.3.2 puts the low fit from 160 to 250 Hz down to them, too; 1 degree changes a fit by 0.0003.",
            means=(1, 90), kind="prediction"),
        Row("the same by hysteresis with a loss angle of 20 degrees", None, _hysteresis(free), "°", None,
            "Of iron, at the least permeability; what the gaps leave of it."),
        Row("step of the coil current within 1 µs of a switch", "vertical discontinuity", 100 * corners[1], "%", None,
            f"Beyond the triangle's own change, of its peak to peak, for a permeability of {PERMEABILITIES[1]:.0f}; "
            f"{100 * corners[0]:.1f} % for {PERMEABILITIES[0]:.0f}. The flux follows the voltage, the field at the "
            "lamination's surface runs ahead of it by the root of time. The triangle itself changes by 5 % in that "
            "time; the size of the published step is in the figure only."),
        Row("steepest flank that a sensor of 150 kHz shows, over the triangle's", "vertical discontinuity", steep, "",
            None, f"For a permeability of {PERMEABILITIES[0]:.0f}; {steepest(frame, PERMEABILITIES[0], 350e3):.1f} "
            "if its response of less than 1 µs means 350 kHz, and without its lag "
            f"{steepest(frame, PERMEABILITIES[0], inf):.1f} over the first 0.1 µs. Eddy currents do run ahead at a "
            "switch, but this sensor would not show it as vertical. An edge of the voltage that couples into the "
            "reading would be.", means=(STEEP, inf), kind="prediction"),
    )  # fmt: skip
    notes = (
        "Laminations of 0.23 mm have a corner frequency of some kHz by themselves, and their reluctance is a few per "
        "cent of the gaps'. What the text explains by eddy currents below 250 Hz, they cannot explain; what it says of "
        "the skin effect agrees.",
    )
    frequency = np.geomspace(10, 20e3, 100)
    curves = [(f"laminations, permeability {mu:g}", np.abs(gain(free, frequency, mu))) for mu in PERMEABILITIES]
    curves += [(f"solid rings, {PERMEABILITIES[1]:g}", np.abs(gain(free, frequency, PERMEABILITIES[1], SOLID)))]
    figure = by_frequency(frequency, curves, "flux over that at rest").update_xaxes(type="log")
    return Outcome(rows, (("Flux per ampere of a bearing with its gaps", figure), _oscillogram(frame)), notes)


def share(frequency: np.ndarray | float, permeability: float, thickness: float = THICKNESS) -> np.ndarray:
    """Mean flux density over a lamination's thickness (m), over that at its surface, by diffusion from both sides."""
    depth = np.sqrt(2j * np.pi * np.asarray(frequency) * permeability * MU_0 / RESISTIVITY) * thickness / 2
    return np.tanh(depth) / depth


def gain(rig: Rig, frequency: np.ndarray | float, permeability: float, thickness: float = THICKNESS) -> np.ndarray:
    """Flux per ampere of a bearing over that at rest: two air gaps, and iron whose reluctance rises by 1 / share."""
    air, iron = 2 * rig.gap, IRON / permeability
    return (air + iron) / (air + iron / share(frequency, permeability, thickness))


def _hysteresis(rig: Rig) -> float:
    air, iron = 2 * rig.gap, IRON / PERMEABILITIES[0] * np.exp(1j * np.radians(20.0))
    return float(np.degrees(np.angle(air + iron)))


def switched(rig: Rig, permeability: float | None, time: np.ndarray, bandwidth: float = inf) -> np.ndarray:
    """Current (A) of an E-frame's coil at half duty, switched at 0 and at half the period; None: without eddies.

    It is read by a sensor of first order with a bandwidth in Hz.
    """
    n = np.arange(1, 4001, 2)
    w = 2 * np.pi * n / PERIOD
    mu = permeability or PERMEABILITIES[1]
    iron = E_FRAME_IRON / mu / (share(w / (2 * np.pi), mu) if permeability else 1.0)
    inductance = MU_0 * rig.turns**2 * rig.pole_area / (2 * rig.gap + iron)
    lines = 4 * rig.supply_voltage / (np.pi * n) / (rig.coil_resistance + 1j * w * inductance)
    lines = lines / (1 + 1j * w / (2 * np.pi * bandwidth))
    return (lines[:, None] * np.exp(1j * np.outer(w, time))).imag.sum(axis=0)


def corner(rig: Rig, permeability: float) -> float:
    """Change of the current within `SOON` of a switch beyond the triangle's own, of the triangle's peak to peak."""
    time = np.array([0.0, SOON, PERIOD / 2])
    plain, eddy = (switched(rig, mu, time) for mu in (None, permeability))
    return float((eddy[1] - eddy[0] - plain[1] + plain[0]) / (plain[2] - plain[0]))


def steepest(rig: Rig, permeability: float, bandwidth: float) -> float:
    """Largest slope of the current after a switch, over 0.1 µs, over that of the triangle without eddy currents."""
    time = np.linspace(0.0, PERIOD / 2, 201)
    read, plain = switched(rig, permeability, time, bandwidth), switched(rig, None, time)
    return float(np.diff(read).max() / np.diff(plain).mean())


def _oscillogram(rig: Rig):
    time = np.linspace(0, PERIOD, 801)
    curves = [("without eddy currents", switched(rig, None, time))]
    curves += [(f"permeability {mu:g}", switched(rig, mu, time)) for mu in PERMEABILITIES[:2]]
    curves += [("the same by a sensor of 150 kHz", switched(rig, PERMEABILITIES[1], time, SENSOR))]
    figure = by_frequency(1e6 * time, curves, "coil current in A").update_xaxes(title_text="µs after a switch")
    return "Switched coil current of an E-frame (Figure 6.17)", figure


ITEM = Item(
    "laminations", "Eddy currents in the laminations", "5.3.2 to 5.3.4, 6.4.1.1; Figures 5.20, 5.22, 5.23, 6.17", run
)
