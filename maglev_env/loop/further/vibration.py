"""A force on the rotor from a foreign source, at a frequency of its own."""

from collections.abc import Callable, Mapping

import numpy as np

from maglev_env.loop.card import EffectCard, Parameter, phase
from maglev_env.loop.further import probe_play
from maglev_env.loop.sensor import turned
from maglev_env.loop.system import Values
from maglev_lanes.layout import LANES as W
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

EFFECTS: Mapping[str, EffectCard] = {
    "foreign_vibration": EffectCard(
        "external",
        {
            "force": Parameter("N", 0.0, 1e5),
            "frequency": Parameter("Hz", 0.001, 1e4, 25.0),
            "phase": phase(),
        },
        "a force F cos(2 pi f t + phase) that nobody applies on purpose: a pump or fan beside the rig",
        "displacement, between the lines",
        flexible=True,
        not_fitted="a tone: it is found by its frequency, see `estimation.lines.tones`",
    ),
}

# Rows of a lane. SHAKE_C, SHAKE_S: the force's pointer, which SHAKE_TURN_C and SHAKE_TURN_S turn by a step. SHAKE: its
# acceleration as coefficients of both at the start, the middle and the end of a step.
SHAKE_C, SHAKE_S, SHAKE_TURN_C, SHAKE_TURN_S, SHAKE, END = rows_after(
    probe_play.END, "SHAKE_C SHAKE_S SHAKE_TURN_C SHAKE_TURN_S SHAKE[6]"
)


def fill(x: LaneRows, values: Values, h: np.ndarray, axis: int) -> None:
    """Write the constants for integration steps of h (s), (n,)."""
    rate, begun = (
        2 * np.pi * values.effect("foreign_vibration", "frequency"),
        values.effect("foreign_vibration", "phase"),
    )
    x[SHAKE_C], x[SHAKE_S] = np.cos(begun), np.sin(begun)
    x[SHAKE_TURN_C], x[SHAKE_TURN_S] = np.cos(rate * h), np.sin(rate * h)
    size = values.effect("foreign_vibration") * h**2 / values.mass
    for node in range(3):
        angle = 0.5 * node * rate * h
        x[SHAKE + 2 * node * W] = size * np.array([np.cos(angle), -np.sin(angle)])


def shaken(node: int) -> Callable:
    """A piece that gives the acceleration by the vibration at node 0, 1 or 2 of a step."""
    first = SHAKE + 2 * node * W

    @piece
    def total(x, k):
        return x[k + first] * x[k + SHAKE_C] + x[k + first + W] * x[k + SHAKE_S]

    return total


@piece
def turn_shake(x, k):
    """Turn the vibration's pointer to the end of the step."""
    x[k + SHAKE_C], x[k + SHAKE_S] = turned(x[k + SHAKE_C], x[k + SHAKE_S], x[k + SHAKE_TURN_C], x[k + SHAKE_TURN_S])
    return 0.0
