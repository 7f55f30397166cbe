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
        {
            "half_width": Parameter("m", 1e-11, 1e-2, absent=0.0, starts=(3e-8, 3e-7, 3e-6, 3e-5), in_proportion=True),
            "spread": Parameter("", 0.0, 1.0, 0.0, scale=1.0, shape=0.4),
        },
        "the reading stays while the rotor moves within the half width either way (a play operator, Krasnosel'skii); "
        "with a spread s it is the mean behind plays of 1 - s, 1 and 1 + s half widths",
        "displacement and force at two amplitudes",
        flexible=True,
        linear=False,
        form_share=0.05,
        dither="always",
    ),
}

# Rows of a lane. PLAYED, EARLIER, LATER: the displacement behind each play, m; PLAY, NARROW, WIDE: half widths, m.
PLAYED, EARLIER, LATER, PLAY, NARROW, WIDE, END = rows_after(springs.END, "PLAYED EARLIER LATER PLAY NARROW WIDE")


def fill(x: LaneRows, values: Values, h: np.ndarray, axis: int) -> None:
    """Write the half widths of the plays."""
    play, spread = values.effect("probe_backlash"), values.effect("probe_backlash", "spread")
    x[PLAY], x[NARROW], x[WIDE] = play, (1 - spread) * play, (1 + spread) * play


@piece
def played(x, k, sensed):
    """The displacement (m) behind the play, which is also stored."""
    play = x[k + PLAY]
    found = min(max(x[k + PLAYED], sensed - play), sensed + play)
    x[k + PLAYED] = found
    return found


@piece
def played_shaped(x, k, sensed):
    """The mean (m) behind plays of several half widths, which are also stored."""
    narrow, wide = x[k + NARROW], x[k + WIDE]
    earlier = min(max(x[k + EARLIER], sensed - narrow), sensed + narrow)
    later = min(max(x[k + LATER], sensed - wide), sensed + wide)
    x[k + EARLIER], x[k + LATER] = earlier, later
    return (earlier + played(x, k, sensed) + later) / 3.0
