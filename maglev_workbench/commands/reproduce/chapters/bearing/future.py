"""Section 7.2, future work, and the pen of 5.4: what the models of this workbench say ahead of the experiments."""

from dataclasses import replace
from math import inf, pi

import numpy as np
import scipy

from maglev_env.design.hydraulics import MMHG, Impeller, Pump, impeller, pressure_rise
from maglev_env.loop.gains import state_space
from maglev_env.rotor.linear import closed_loop_poles, continuous, control_matrices, mechanics
from maglev_env.rotor.rotor import Rotor, load_rotor
from maglev_env.rotor.run_up import run_up
from maglev_workbench.commands.reproduce.chapter_figures import by_frequency
from maglev_workbench.commands.reproduce.chapters.bearing import hydraulics
from maglev_workbench.commands.reproduce.chapters.bearing.passive_force import FACES, TABLE_5_4, Passive, axial_pull
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row, Table

DESIGN, TOP, WORST = 9007.05, 14_000.0, 10_000.0  # rpm
SUPPLY = 32.5  # W, at 10,000 rpm (3.5)
LENGTH = 70e-3  # m, of the rotor, as its preset assumes
WATER = (998.0, 1.0e-3)  # kg/m3, Pa s
BLOOD = (1060.0, 3.5e-3)
SWIRL = 0.5  # mean turning of the fluid in the gap over that of the rotor
MEASURED = 5.56e-4  # s: 30 degrees at 150 Hz (6.4)
SIMULATED = 4.5e-5  # s: dynamic-calibration
FLOWS = np.linspace(0.0, 14.0, 29)  # L/min


def run(seed: int) -> Outcome:
    """Zero bias current by simulation; fluid, self-sensing and pump curve by linear and Euler's theory."""
    rotor = load_rotor("pump")
    quiet = replace(rotor, axis=replace(rotor.axis, bias_current=0.0))
    speeds = np.array([0.0, WORST, TOP])
    with_bias, without = (run_up([r], speeds, seed=seed) for r in (rotor, quiet))
    blades = impeller(hydraulics.PUMP, *hydraulics.PRINTED_ANGLES)
    least, most = (pump_curve(hydraulics.PUMP, blades, FLOWS, lossy) for lossy in (True, False))
    power = blades.pressure * hydraulics.PUMP.flow_rate
    poles = {name: [right_most(rotor, rpm, *fluid(rotor, *f)) for rpm in (0.0, DESIGN, TOP)]
             for name, f in (("water", WATER), ("blood", BLOOD))}  # fmt: skip
    air = [right_most(rotor, rpm) for rpm in (0.0, DESIGN, TOP)]
    mass = fluid(rotor, *WATER)[0]
    slow, fast = (replace(rotor, axis=replace(rotor.axis, sensor_time_constant=t)) for t in (MEASURED, SIMULATED))
    z, pull = axial_pull(rotor)
    steep = Passive(z, pull).stiffness / TABLE_5_4
    rows = (
        Row("touchdowns at zero bias current, 0 to 14,000 rpm", "can be adopted", float(without.touched_down.sum()),
            "", None, "3.5. The magnet gives the bias; the coils need none.", means=(0, 0), kind="prediction"),
        Row("copper loss at 10,000 rpm without the bias current", None, float(without.copper_loss[0, 1]), "W", None,
            f"Instead of {with_bias.copper_loss[0, 1]:.2f} W."),
        Row("of the 32.5 W at 10,000 rpm, saved by it", None,
            100 * float(with_bias.copper_loss[0, 1] - without.copper_loss[0, 1]) / SUPPLY, "%", None,
            "Most is lost in the amplifiers (coil-current), which is why other ones are the third point of 7.2."),
        Row("right-most pole in water at 9,007 rpm", "good performance foreseen", poles["water"][1], "1/s",
            None, f"Foreseen in 7.1, as fluid damps. Water in the gap along {1e3 * LENGTH:.0f} mm adds {mass:.2f} kg "
            f"to the rotor's {rotor.body.mass:.2f} kg, and turns with half of its speed. In air {air[1]:.0f} 1/s.",
            means=(-inf, 0), kind="prediction"),
        Row("the same at 14,000 rpm", "good performance foreseen", poles["water"][2], "1/s", None,
            f"Half-speed whirl: the fluid drives what moves slower than half a turn per turn. In blood "
            f"{poles['blood'][2]:.0f} 1/s. It would take more damping, or something that keeps the fluid from turning.",
            means=(-inf, 0), kind="prediction", again="future-work"),
        Row("the same in blood at 9,007 rpm", "good performance foreseen", poles["blood"][1], "1/s", None, "",
            means=(-inf, 0), kind="prediction", again="future-work"),
        Row("right-most pole on self-sensing as measured, 0 rpm", None, right_most(slow, 0.0), "1/s", None,
            f"556 µs as a first-order lag in all four radial axes, gains of Table 3.5; with a probe {air[0]:.0f} 1/s. "
            "Edge by edge, and read at the coils: pump-on-coils."),
        Row("the same at 14,000 rpm", None, right_most(slow, TOP), "1/s", None,
            "Gyroscopic moments take some of it."),
        Row("right-most pole on self-sensing as simulated, 14,000 rpm", None, right_most(fast, TOP), "1/s", None,
            "45 µs: the estimator as designed costs nothing. The measured lag leaves a third of the decay, and as a "
            "pure delay it takes the whole margin (dynamic-calibration)."),
        Row("pressure at 5 L/min, Euler", 13309.8, float(pressure_rise(
            hydraulics.PUMP, blades, blades.speed, hydraulics.PUMP.flow_rate)), "Pa", 0.01,
            "The curve's point of Table 3.1.", kind="consequence", again="hydraulics"),
        Row("pressure without flow, Euler", None, float(most[0]) / MMHG, "mmHg", None,
            "No incidence losses; with the whole of them at both rows of blades none is left without flow."),
        Row("flow at which the pressure is gone, Euler", None, float(np.interp(0.0, -most, FLOWS)), "L/min", None,
            "The measured curve of 7.2 has to lie between both."),
        Row("hydraulic power over the 32.5 W taken, 5 L/min", None, 100 * power / SUPPLY, "%", None,
            f"{power:.2f} W at 9,007 rpm at best, where the motor in air takes 5.2 W and the bearings 27.3 W."),
        Row("largest passive force on a pen", "maintains the rotor's position", float(pull.max()), "N", None,
            f"5.4. At {1e3 * z[pull.argmax()]:.1f} mm, by the section of flux-map at {FACES} faces, {steep:.1f} times "
            f"as stiff as Table 5.4; in proportion to that {pull.max() / steep:.1f} N. A pen is pushed with some 1 N.",
            means=(1, inf), kind="prediction"),
        Row("displacement by 1 N, Table 5.4", None, 1e6 / TABLE_5_4, "µm", None, "1 N over 2.471 kN/m."),
    )  # fmt: skip
    flows = [i for i, q in enumerate(FLOWS) if q in (0, 3, 5, 7, 9, 12)]
    table = Table(
        "Pump curve at 9,007 rpm",
        ("flow in L/min", "pressure in mmHg, Euler", "less all incidence losses", "hydraulic efficiency, at least"),
        tuple(
            (f"{FLOWS[i]:g}", f"{most[i] / MMHG:.1f}", f"{least[i] / MMHG:.1f}", f"{max(least[i] / most[i], 0):.2f}")
            for i in flows
        ),
    )
    notes = (
        "The fluid is that of a long concentric gap (Fritz 1970): added mass by potential flow, damping by laminar "
        "squeezing, both turning with half the speed of the rotor, over the whole assumed length. A gap that is "
        "interrupted by slots and open at its ends has less of each. The half-speed whirl does not depend on the size "
        "alone: without its damping the added mass makes the loop unstable at 9,007 rpm already.",
        "The stiffness against flow in the axial direction (7.2, point 2) is in thrust.",
    )
    curves = [("Euler", most / MMHG), ("less all incidence losses", least / MMHG)]
    figure = by_frequency(FLOWS, curves, "pressure in mmHg").update_xaxes(title_text="flow in L/min")
    push = by_frequency(1e3 * z, [("16 faces", pull)], "N").update_xaxes(title_text="axial displacement in mm")
    return Outcome(rows, (("Pump curve (7.2)", figure), ("Passive axial force", push)), notes, (table,))


def fluid(rotor: Rotor, density: float, viscosity: float) -> tuple[float, float]:
    """Added mass (kg) and damping (N s/m) of a concentric gap around the rotor, both without end effects.

    Potential flow between cylinders, and the pressure that laminar flow around the circumference needs.
    """
    a, b = rotor.body.radius, rotor.body.radius + rotor.axis.gap
    mass = pi * density * a**2 * LENGTH * (b**2 + a**2) / (b**2 - a**2)
    return mass, 12 * pi * viscosity * LENGTH * a**3 / rotor.axis.gap**3


def right_most(rotor: Rotor, rpm: float, mass: float = 0.0, damping: float = 0.0) -> float:
    """Largest real part (1/s) of the poles of the loop, with a fluid around the rotor that turns along with it."""
    speed = rpm * pi / 30
    poles = closed_loop_poles(rotor, speed) if not mass else np.linalg.eigvals(_in_fluid(rotor, speed, mass, damping))
    return float(np.log(np.abs(poles).max()) * rotor.axis.control_rate)


def _in_fluid(rotor: Rotor, speed: float, mass: float, damping: float) -> np.ndarray:
    """State matrix of the sampled loop of x + i y and its tilt; a fluid's forces are those in its turning frame.

    There they are -M q'' - c q'; over its length they make moments of a twelfth of the length's square as much.
    """
    rates, turn = continuous(rotor, speed), SWIRL * speed
    lever = np.array([1.0, LENGTH**2 / 12])
    m, c = mass * lever, damping * lever
    body = np.diag(mechanics(rotor).mass)[:2]
    rates[2:4] *= (body / (body + m))[:, None]
    rates[2:4, :2] += np.diag((m * turn**2 + 1j * c * turn) / (body + m))
    rates[2:4, 2:4] += np.diag((2j * m * turn - c) / (body + m))
    dt = 1 / rotor.axis.control_rate
    whole = scipy.linalg.expm(np.vstack([rates, np.zeros((4, 12))]) * dt)
    into, out = (matrix[::2, ::2] for matrix in control_matrices(rotor))
    a, b, seen = whole[:8, :8], whole[:8, 8:10] @ out, into @ np.eye(8)[4:6]
    parts = [state_space(g, dt) for g in rotor.gains.values()]
    ka, kb = scipy.linalg.block_diag(*(p[0] for p in parts)), scipy.linalg.block_diag(*(p[1][:, None] for p in parts))
    kc, kd = scipy.linalg.block_diag(*(p[2][None] for p in parts)), np.diag([p[3] for p in parts])
    return np.block([[a - b @ kd @ seen, b @ kc], [-kb @ seen, ka]])


def pump_curve(pump: Pump, blades: Impeller, flows: np.ndarray, lossy: bool) -> np.ndarray:
    """Pressure (Pa) at flows (n,) L/min and the design speed; lossy: less the whole velocity by which the flow misses
    the blades of the impeller and of the diffuser."""
    ratio = flows * hydraulics.LITRE_PER_MINUTE / pump.flow_rate
    ideal = np.array([pressure_rise(pump, blades, blades.speed, r * pump.flow_rate) for r in ratio])
    missed = blades.blade_velocity * (1 - ratio)  # at both: the triangles fit at the design flow
    return ideal - lossy * pump.density * missed**2


ITEM = Item("future-work", "Future work, and a pen", "Sections 7.1, 7.2 and 5.4", run)
