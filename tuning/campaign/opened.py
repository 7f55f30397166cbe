"""Responses with the loop opened: of a rig's linear model, and of what recordings show."""

from collections.abc import Sequence

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import effect_value
from maglev_env.rig.rig import Rig
from tuning.campaign.differences import places
from tuning.campaign.gain_set import GainSet, Response
from tuning.search.corrected.parameters import LAGS


def open_responses(rig: Rig, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Plant and free receptance of a rig's linear model; the hold of the force is removed, as of measured ones."""
    loop = loop_response(Experiment(rig, rig.gains, ()), frequency)
    x = frequency / rig.control_rate
    return loop.plant, loop.receptance / loop.sensitivity / (np.sinc(x) * np.exp(-1j * np.pi * x))


def opened(
    shaken: Sequence[GainSet], loops: Sequence[np.ndarray], plant: np.ndarray, wanted: np.ndarray
) -> list[Response]:
    """Receptances with their loops opened: by controllers and the plant, (w,) each, at frequencies wanted (w,)."""
    parts = []
    for s, c in zip(shaken, loops, strict=True):
        at = places(wanted, s.receptance.frequency)
        opening = 1 + c[at] * plant[at]
        parts.append(Response(wanted[at], s.receptance.value * opening, s.receptance.variance * np.abs(opening) ** 2))
    return parts


def lags(rig: Rig) -> float:
    """Sum of a rig's lags, s."""
    own = rig.amplifier_time_constant + rig.sensor_time_constant
    return own + sum(effect_value(rig.effects, name) for name in LAGS)
