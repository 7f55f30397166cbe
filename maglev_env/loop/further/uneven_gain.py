"""Where the gain from current to force is not one number: other for either sign, or changing over time."""

from collections.abc import Mapping

import numpy as np

from maglev_env.loop.card import EffectCard, Parameter, phase
from maglev_env.loop.exponential import faded
from maglev_env.loop.further import command_path
from maglev_env.loop.mechanics import STEPS
from maglev_env.loop.sensor import turned
from maglev_env.loop.system import Values
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

EFFECTS: Mapping[str, EffectCard] = {
    "asymmetric_gain": EffectCard(
        "actuator",
        {"change": Parameter("", -0.9, 0.9, scale=0.05, starts=(-0.1, 0.1))},
        "the force-producing current is i + change |i|, where i counts from rest: the halves of a bridge or of a pair "
        "differ",
        "current and displacement at two amplitudes, with means",
        ("magnets",),
        flexible=True,
        linear=False,
        form_share=0.02,
        dither="maybe",
    ),
    "gain_drift": EffectCard(
        "actuator",
        {
            "rate": Parameter("1/s", -10.0, 10.0, scale=0.01, starts=(-0.1, -0.01, 0.01, 0.1)),
            "depth": Parameter("", 0.0, 0.9, 0.0),
            "frequency": Parameter("Hz", 0.001, 1e4, 1.0),
            "phase": phase(),
            "settling": Parameter("1/s", 0.0, 100.0, 0.0, shape=1.0, scale=0.3),
        },
        "the force-producing current, counted from rest, is multiplied by 1 + rate t + depth sin(2 pi f t + phase): "
        "warming, a supply that sags or ripples, where another source makes the bias or carries the weight; in another "
        "form t is (1 - e^(-settling t)) / settling, as of what becomes as warm as it will",
        "displacement, by periods",
        ("magnets",),
        flexible=True,
        linear=False,
        form_share=0.01,
        left_alone=("depth", "frequency", "phase"),
    ),
}

# Rows of a lane. ASYMMETRY: relative. RATE: relative change in a step. DEPTH: relative. WAVE_C, WAVE_S: the pointer of
# the modulation in the middle of a step, which WAVE_TURN_C and WAVE_TURN_S turn by a step. SETTLES: by which share of
# what is left of it a drift settles in a step.
ASYMMETRY, RATE, DEPTH, WAVE_C, WAVE_S, WAVE_TURN_C, WAVE_TURN_S, SETTLES, END = rows_after(
    command_path.END, "ASYMMETRY RATE DEPTH WAVE_C WAVE_S WAVE_TURN_C WAVE_TURN_S SETTLES"
)


def fill(x: LaneRows, values: Values, h: np.ndarray, axis: int) -> None:
    """Write the constants for integration steps of h (s), (n,)."""
    turn = 2 * np.pi * values.effect("gain_drift", "frequency") * h
    begun = values.effect("gain_drift", "phase") + 0.5 * turn
    x[ASYMMETRY] = values.effect("asymmetric_gain")
    x[RATE], x[DEPTH] = values.effect("gain_drift") * h, values.effect("gain_drift", "depth")
    x[SETTLES] = values.effect("gain_drift", "settling") * h
    x[WAVE_C], x[WAVE_S] = np.cos(begun), np.sin(begun)
    x[WAVE_TURN_C], x[WAVE_TURN_S] = np.cos(turn), np.sin(turn)


@piece
def pulling(x, k, current):
    """The force-producing current (A) with its uneven gain, that of the middle of the step."""
    gain = 1.0 + x[k + RATE] * (x[k + STEPS] + 0.5) + x[k + DEPTH] * x[k + WAVE_S]
    return gain * (current + x[k + ASYMMETRY] * abs(current))


@piece
def pulling_shaped(x, k, current):
    """The same with a drift that settles."""
    steps = x[k + STEPS] + 0.5
    way = x[k + SETTLES] * steps
    lasting = steps * (1.0 - 0.5 * way) if way < 1e-6 else (1.0 - faded(way)) / x[k + SETTLES]
    gain = 1.0 + x[k + RATE] * lasting + x[k + DEPTH] * x[k + WAVE_S]
    return gain * (current + x[k + ASYMMETRY] * abs(current))


@piece
def turn_wave(x, k):
    """Turn the modulation's pointer to the end of the step."""
    x[k + WAVE_C], x[k + WAVE_S] = turned(x[k + WAVE_C], x[k + WAVE_S], x[k + WAVE_TURN_C], x[k + WAVE_TURN_S])
    return 0.0
