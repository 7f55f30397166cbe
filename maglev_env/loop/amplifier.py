"""The amplifier's block: what lies between the command and the coil's current."""

from collections.abc import Mapping
from math import inf

import numpy as np

from maglev_env.loop.card import EffectCard, Parameter, first_order
from maglev_env.loop.system import System, Values

EFFECTS: Mapping[str, EffectCard] = {
    "amplifier_lag": EffectCard(
        "amplifier",
        first_order(),
        "a second amplifier pole 1 / (1 + s T) after the nominal one",
        "command and current",
        ("magnets",),
        form_share=0.005,
    ),
    "amplifier_voltage_limit": EffectCard(
        "amplifier",
        {"voltage": Parameter("V", 1e-3, 1e5, absent=inf, starts=tuple(np.geomspace(0.1, 20.0, 40)))},
        "|L di/dt + R i| <= V: the coil's current cannot follow faster",
        "command and current at two amplitudes",
        ("coil",),
        flexible=True,
        linear=False,
        form_share=0.15,
        dither="always",
    ),
}


STATES = ("amplifier", "amplifier_lag")


def coil_current(system: System, values: Values, command: np.ndarray) -> np.ndarray:
    """The amplifier's poles: from the command to the coil's current, both signals in A."""
    return system.lags(STATES, (values.rig("amplifier_time_constant"), values.effect("amplifier_lag")), command)
