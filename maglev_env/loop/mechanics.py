"""The mechanics' block: the rotor's mass, its support, friction and what else moves with it."""

from collections.abc import Mapping

from maglev_env.loop.card import EffectCard, Parameter, relative
from maglev_env.loop.resonance import RESONANCE_DAMPING, RESONANCE_FREQUENCY

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
