"""What errors of the measured current or command that drives a simulation change in the opened coordinates."""

from collections.abc import Mapping

import numpy as np

from maglev_env.kernel.blocks import Block
from sim2real.compared.point import Point
from sim2real.compared.simulated import Predictor
from sim2real.compared.whole_gain import with_more_gain
from sim2real.recorded.channel_errors import ChannelError
from sim2real.recorded.open_evidence import SMALL, Replay, coordinates_of, exact_errors, redriven, simulated_series
from sim2real.recorded.open_record import OpenRecord


def drive_columns(
    as_read: OpenRecord,
    predicts: Predictor,
    lanes: list[Block],
    near: Point,
    about: Mapping[ChannelError, float],
    at: np.ndarray,
) -> dict[str, np.ndarray]:
    """Change of the coordinates (outputs, axes, n), measured less predicted, by one standard deviation of each error.

    Args:
        as_read: The record before errors are put right.
        predicts: Of the record with the errors put right in the amounts `about`, with what noise in its drive makes.
        lanes: Prepared ones of the point `near`.
        near: The point of comparison.
        about: Error -> amount in standard deviations.
        at: Coordinates (outputs, axes, n) there.

    Returns:
        Name of the error -> change; zero where the rotor touches down.
    """
    replay = predicts.replay
    assert isinstance(replay, Replay)
    found = {}
    for error in exact_errors(as_read):
        if about and as_read.axes == 1 and error.scale and as_read.source == "current":
            # The scale of the current is that of the actuator's gain. Simulated as such, also the part that the
            # stand-in makes of what the rig does not explain, it is exactly as unknown, and no recording tells both.
            # That holds about one fit; hypotheses that lie elsewhere are compared with the drive as it was read.
            stronger, share = with_more_gain(as_read.experiment, near, SMALL * error.scale)
            (moved,) = predicts([stronger])
            change = np.sign(share) * (at - moved)
        else:
            own = redriven(as_read, {**about, error: about.get(error, 0.0) + SMALL})
            change = at - coordinates_of(own, replay.loop, replay.outputs, simulated_series(own, lanes)[0])
        found[error.name] = np.where(np.isfinite(change).all(), change / SMALL, 0.0)
    return found
