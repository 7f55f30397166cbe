"""All rules that compare a recording with itself.

They need no rig (only its clearance is used), and say nothing of a sound recording (the tests count false alarms on
simulated records).
"""

from typing import TYPE_CHECKING

from maglev_env.recordings.alarms.alarm import Alarm
from maglev_env.recordings.alarms.lost_levitation import lost_levitation
from maglev_env.recordings.alarms.repeated import repeated_samples
from maglev_env.recordings.alarms.stored_again import blocks_stored_again
from maglev_env.recordings.alarms.stuck import stuck_readings
from maglev_env.rig.rig import Rig

if TYPE_CHECKING:
    import xarray as xr


def find_alarms(dataset: "xr.Dataset", start: int = 0, rig: Rig | None = None) -> tuple[Alarm, ...]:
    """Lost levitation, stuck readings, and repeated samples and stretches of a recording.

    Args:
        dataset: As `read_recording` makes it; where it was resampled with a coordinate `row` over time, the row of
            each sample from the first one used.
        start: Row of the file at which it begins, for the sentences.
        rig: Its nominal rig, for its clearance.
    """
    found = lost_levitation(dataset, start, rig)
    lost = {a.channel for a in found}
    stuck = [a for a in stuck_readings(dataset, start) if a.channel not in lost]
    return (*found, *stuck, *repeated_samples(dataset, start), *blocks_stored_again(dataset, start))
