"""The mechanics' block: the rotor's mass, its support, friction and what else moves with it."""

from collections.abc import Mapping

import numpy as np

from maglev_env.loop.card import EffectCard, Parameter, relative
from maglev_env.loop.resonance import RESONANCE_DAMPING, RESONANCE_FREQUENCY
from maglev_env.loop.system import System, Values

EFFECTS: Mapping[str, EffectCard] = {
    "mass": EffectCard(
        "mechanics",
        relative((-0.2, -0.03, 0.03, 0.3)),
        "relative change of the moving mass",
        "force and displacement",
        nominal="mass",
    ),
    "support_stiffness": EffectCard(
        "mechanics",
        relative((-0.2, -0.03, 0.03, 0.3)),
        "relative change of the support's stiffness, D Table 5.1",
        "force and displacement",
        ("support",),
        nominal="support_stiffness",
    ),
    "damping": EffectCard(
        "mechanics",
        {"coefficient": Parameter("N s/m", -100.0, 1000.0, scale=1.0, starts=(-2.0, 1.0, 20.0))},
        "viscous damping added to the support",
        "force and displacement",
        form_share=0.005,
    ),
    "friction": EffectCard(
        "mechanics",
        {
            "force": Parameter("N", 0.0, 1e4, scale=0.02, starts=(0.05,)),
            "velocity": Parameter("m/s", 1e-5, 10.0, 1e-3, starts=(3e-4, 3e-3)),
            # The smallest presliding is as good as none.
            "presliding": Parameter("m", 1e-9, 1e-3, 0.0, starts=(1e-9, 3e-7, 3e-6)),
        },
        "Coulomb's, smooth about rest: F v / sqrt(v^2 + v_s^2); with presliding z_s it sticks: F z / z_s, "
        "dz/dt = v - sqrt(v^2 + v_s^2) z / z_s (Dahl 1968; Canudas de Wit et al. 1995)",
        "force and displacement at two amplitudes",
        flexible=True,
        linear=False,
        form_share=0.05,
        dither="maybe",
    ),
    "support_resonance": EffectCard(
        "mechanics",
        {
            "frequency": RESONANCE_FREQUENCY,
            "damping_ratio": RESONANCE_DAMPING,
            "mass_ratio": Parameter("", 0.0, 2.0, 0.05, scale=0.02, starts=(0.01,)),
        },
        "a second body on a spring on the mover; its frequency is that of the second body on a mover held fast",
        "force and displacement across the resonance",
        flexible=True,
        resonance=True,
    ),
    "cross_coupling": EffectCard(
        "mechanics",
        {"ratio": Parameter("", -0.9, 0.9, scale=0.05, starts=(-0.05, 0.05))},
        "each axis' magnet force also pushes the other axis, by this ratio",
        "displacement of both axes, excited in turn",
        ("magnets", "two_axes"),
        not_sealed="the sealed twin has one axis",
    ),
}


MOTION = ("position", "velocity")
BODY = ("body", "body_velocity")  # of the second body, relative to the mover
STATES = ("bristle", *BODY)


def support(system: System, values: Values) -> np.ndarray:
    """Force (N) of the support and of friction about rest, where bristles are a spring in series with the slip."""
    position, velocity = (system.signal(name) for name in MOTION)
    stiffness = values.rig("support_stiffness") * (1 + values.effect("support_stiffness"))
    damping = values.rig("support_damping") + values.effect("damping")
    rub, slip, presliding = (values.effect("friction", key) for key in ("force", "velocity", "presliding"))
    sticks = presliding > 0
    damping = damping + np.where(sticks, 0.0, rub / slip)
    smooth = -stiffness[:, None] * position - damping[:, None] * velocity
    if system.without(("bristle",), sticks):
        return smooth
    bent = system.signal("bristle")
    gives_way = np.where(sticks, presliding, 1.0)[:, None]
    system.put("bristle", (velocity - slip[:, None] * bent) / gives_way, sticks)
    springing = np.where(sticks, rub, 0.0)
    return smooth - springing[:, None] * bent


def motion(system: System, values: Values, acceleration: np.ndarray) -> None:
    """The rotor as bearing and held force accelerate it (m per unit of time squared), and the second body with it."""
    system.integrate(MOTION)
    system.put(MOTION[1], second_body(system, values, acceleration))


def second_body(system: System, values: Values, acceleration: np.ndarray) -> np.ndarray:
    """The rotor's acceleration with the second body on its spring, from that by all other forces on the rotor.

    Relative to the rotor the body is an oscillator of 1 + ratio times its stiffness, driven by those other forces.
    """
    frequency = values.effect("support_resonance")
    ratio = np.where(frequency > 0, values.effect("support_resonance", "mass_ratio"), 0.0)
    if system.without(BODY, there := ratio > 0):
        return acceleration
    damping_ratio = values.effect("support_resonance", "damping_ratio")
    returning = system.oscillator(BODY, frequency, damping_ratio, 1 + ratio)
    system.put(BODY[1], returning - acceleration)
    system.there[:, system.at(*BODY)] = there[:, None]
    return acceleration - (ratio / (1 + ratio))[:, None] * returning
