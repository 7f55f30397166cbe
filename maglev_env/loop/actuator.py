"""The actuator's block: what lies between the coil's current and the force on the rotor."""

from collections.abc import Mapping
from math import inf

from maglev_env.loop import eddy
from maglev_env.loop.card import EffectCard, Parameter, relative

EFFECTS: Mapping[str, EffectCard] = {
    "actuator_gain": EffectCard(
        "actuator",
        relative((-0.3, -0.05, 0.05, 0.4, 1.5, 3.5)),
        "relative change of df/di: D 5.2.3 measures 5.7, eq 3.13 1.28",
        "current, force and displacement",
        ("magnets",),
        nominal="actuator_gain",
    ),
    "negative_stiffness": EffectCard(
        "actuator",
        relative((-0.7, -0.4, -0.15, 0.2, 1.0)),
        "relative change of -df/dy, D eq 3.12",
        "current, force and displacement",
        ("magnets",),
        nominal="negative_stiffness",
    ),
    **eddy.EFFECTS,
    "hysteresis": EffectCard(
        "actuator",
        {
            "strength": Parameter("", 0.0, 0.9, scale=0.05, starts=(0.05, 0.3)),
            "width": Parameter("A", 1e-4, 100.0, 0.1, starts=(0.01, 0.05, 0.2)),
        },
        "a share of the current lags by a width, as Dahl's rate-independent model has it (Dahl 1968)",
        "current and displacement at two amplitudes",
        ("magnets",),
        flexible=True,
        linear=False,
        form_share=0.2,
        dither="maybe",
    ),
    "saturation": EffectCard(
        "actuator",
        {"field": Parameter("T", 0.1, 100.0, absent=inf, starts=(0.7, 1.0, 1.5, 2.2))},
        "the iron bends: B^2 of each gap becomes B^2 / sqrt(1 + (B / B_s)^4)",
        "current and displacement at two amplitudes",
        ("pair",),
        form_share=0.02,
    ),
    "eccentricity": EffectCard(
        "actuator",
        {"offset": Parameter("m", -0.01, 0.01, scale=1e-5, starts=(-4e-5, -5e-6, 5e-6, 4e-5))},
        "the magnetic centre lies beside the sensed one, D 5.2.3",
        "displacement at two static offsets",
        ("magnets",),
        flexible=True,
    ),
}
