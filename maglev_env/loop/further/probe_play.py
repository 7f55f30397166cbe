"""Backlash of the probe: its reading follows the rotor only behind a play."""

from collections.abc import Mapping

import numpy as np

from maglev_env.loop.card import EffectCard, Parameter
from maglev_env.loop.further import springs
from maglev_env.loop.system import Values
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

EFFECTS: Mapping[str, EffectCard] = {
    "probe_backlash": EffectCard(
        "sensor",
        {"half_width": Parameter("m", 1e-11, 1e-2, absent=0.0, starts=(3e-8, 3e-7, 3e-6, 3e-5))},
        "the reading stays while the rotor moves within the half width either way (a play operator, Krasnosel'skii)",
        "displacement and force at two amplitudes",
        flexible=True,
        linear=False,
        form_share=0.05,
        dither="always",
    ),
}

# Rows of a lane. PLAYED: the displacement that is read, m; PLAY: half width, m.
PLAYED, PLAY, END = rows_after(springs.END, "PLAYED PLAY")


def fill(x: LaneRows, values: Values, h: np.ndarray, axis: int) -> None:
    """Write the half width of the play."""
    x[PLAY] = values.effect("probe_backlash")


@piece
def played(x, k, sensed):
    """The displacement (m) behind the play, which is also stored."""
    play = x[k + PLAY]
    found = min(max(x[k + PLAYED], sensed - play), sensed + play)
    x[k + PLAYED] = found
    return found
