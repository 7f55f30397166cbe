"""Between the recorded command and the one that acts: a dead band, and samples that are dropped."""

from collections.abc import Mapping

import numpy as np
import scipy

from maglev_env.loop import external
from maglev_env.loop.card import EffectCard, Parameter
from maglev_env.loop.controller import U
from maglev_env.loop.exponential import faded, log_beyond
from maglev_env.loop.system import Values
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.noise import drawn
from maglev_lanes.pieces import piece

EFFECTS: Mapping[str, EffectCard] = {
    "deadband": EffectCard(
        "controller",
        {
            "half_width": Parameter("A", 1e-6, 100.0, absent=0.0, starts=(3e-3, 0.02, 0.1), in_proportion=True),
            "rounding": Parameter("A", 1e-6, 100.0, 0.0, starts=(1e-3, 0.03)),
        },
        "commands within the half width do nothing, larger ones lack it, with edges rounded as noise of the command "
        "with this standard deviation rounds their mean: the crossover of a bridge, dead time of its switches",
        "command and current at two amplitudes",
        ("magnets",),
        flexible=True,
        linear=False,
        form_share=0.02,
    ),
    "dropped_samples": EffectCard(
        "controller",
        {"probability": Parameter("", 0.0, 0.95, scale=0.05, starts=(0.05, 0.3))},
        "a new command is lost with this probability and the one before repeated; without noise its expected value "
        "(1 - p) / (1 - p / z) is simulated",
        "command and current; the current then scatters more than its meter's noise",
        ("magnets",),
        flexible=True,
        form_share=0.005,
    ),
}

# Rows of a lane. PASSED: the command passed on last, A. HALF_WIDTH: of the dead band, A; ROUND: scale of the noise that
# rounds it, A, and PER_ROUND its inverse. REPEATED: share of the last command in the next one, without noise; LOST: a
# command is lost where the normal number LUCK is below it.
PASSED, HALF_WIDTH, ROUND, PER_ROUND, REPEATED, LOST, LUCK, END = rows_after(
    external.END, "PASSED HALF_WIDTH ROUND PER_ROUND REPEATED LOST LUCK"
)
LOGISTIC = 3**0.5 / np.pi  # scale of a logistic distribution by its standard deviation
SHARP = 1e-15  # A, below which an edge is sharp
NEVER = -1e3  # below every number that is drawn
APART = 1 << 62  # in the counts of numbers drawn, so that no reading's noise is used again


def fill(x: LaneRows, values: Values, h: np.ndarray, axis: int) -> None:
    """Write the constants; a lane without noise has the expected value in place of what is drawn."""
    probability, noisy = values.effect("dropped_samples"), values.noise > 0
    scale = LOGISTIC * values.effect("deadband", "rounding")
    x[HALF_WIDTH], x[ROUND], x[PER_ROUND] = values.effect("deadband"), scale, 1 / np.maximum(scale, SHARP)
    x[REPEATED] = np.where(noisy, 0.0, probability)
    x[LOST] = np.where(
        noisy & (probability > 0), scipy.special.ndtri(np.where(probability > 0, probability, 0.5)), NEVER
    )


@piece
def try_luck(x, b, seeds, first, lanes, count):
    """Draw, for the axis at b, whether the command of this sample is lost; arguments as `kernel.sample.draw`."""
    for i in range(lanes):
        x[b + i + LUCK] = drawn(seeds[first + i], count + np.uint64(APART))


@piece
def rounded_size(x, scale, per_scale):
    """Mean of the size of x under logistic noise of a scale, which differs from normal noise by a thirtieth of it."""
    size = max(x, -x)
    return size + 2.0 * scale * log_beyond(faded(size * per_scale))


@piece
def left_of(u, half, scale, per_scale):
    """What a dead band leaves of the command u: of a sharp one max(u - half, 0) + min(u + half, 0)."""
    return u + 0.5 * (rounded_size(u - half, scale, per_scale) - rounded_size(u + half, scale, per_scale))


@piece
def passed_on(x, k):
    """The command that is passed on (A)."""
    beyond = left_of(x[k + U], x[k + HALF_WIDTH], x[k + ROUND], x[k + PER_ROUND])
    repeated = 1.0 if x[k + LUCK] < x[k + LOST] else x[k + REPEATED]
    return beyond + repeated * (x[k + PASSED] - beyond)
