"""The external block: forces on the rotor from outside the loop."""

from collections.abc import Callable, Mapping

import numpy as np

from maglev_env.loop import sensor
from maglev_env.loop.card import EffectCard, Parameter, phase
from maglev_env.loop.mechanics import held_force
from maglev_env.loop.sensor import SHAFT_C, SHAFT_S
from maglev_env.loop.system import Values
from maglev_lanes.layout import LANES as W
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

EFFECTS: Mapping[str, EffectCard] = {
    "unbalance": EffectCard(
        "external",
        {"moment": Parameter("kg m", 0.0, 1.0), "phase": phase()},
        "a force m e Omega^2 at the speed of rotation",
        "displacement at two speeds",
        flexible=True,
        not_fitted="a tone: it is found by its frequency, see `estimation.lines.tones`",
    ),
}


# Coefficients of the shaft pointer's cosine and sine for the unbalance's acceleration at the start, the middle and the
# end of a step.
UNBALANCE, END = rows_after(sensor.END, "UNBALANCE[6]")


def fill(x: LaneRows, values: Values, h: np.ndarray) -> None:
    """Write the constants of the unbalance for integration steps of h (s), (n,)."""
    force = values.effect("unbalance") * values.speed**2 * h**2 / values.mass
    # Relative to the runout's phase, because the shaft's pointer carries that phase.
    ahead = values.effect("unbalance", "phase") - values.effect("runout", "phase")
    for node in range(3):
        angle = ahead + 0.5 * node * values.speed * h
        x[UNBALANCE + 2 * node * W] = force * np.array([np.cos(angle), -np.sin(angle)])


def outside(node: int) -> Callable:
    """A piece that gives the acceleration by the held force and the unbalance at node 0, 1 or 2 of a step."""
    first = UNBALANCE + 2 * node * W

    @piece
    def total(x, k, force):
        return held_force(x, k, force) + x[k + first] * x[k + SHAFT_C] + x[k + first + W] * x[k + SHAFT_S]

    return total
