"""Recordings whose simulation by the nominal rig says nothing of them: it falls there, or nothing moves it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from maglev_env.recordings.campaign import Campaign
from maglev_env.recordings.left_out import LeftOut
from sim2real.compared.point import NOMINAL
from sim2real.compared.simulated import lanes_of
from sim2real.recorded.open_evidence import simulated_series
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record

# Power of the simulated motion over that of the recorded one, in each window of lines, below which what is known of
# the drive is not what moved the rotor: noise or an unrecorded force did, as where it hovers.
QUIET = 1e-3
STILL = "what is known of the drive moves the rotor no more than the noise does"
EXCITE = "record larger steps, an injection, or the force that acted"
INSTEAD = "record less motion, or look at this recording alone: `maglev diagnose` asks what would make it stand"


def standing(
    campaign: Campaign, records: Sequence[Record | OpenRecord]
) -> tuple[Campaign, tuple[Record | OpenRecord, ...]]:
    """Leave out recordings without a period in whose simulation the nominal rig falls or rests, if others are left.

    A fit that begins at the nominal rig would be lost in all recordings for the sake of one. Where it falls in all of
    them, the nominal rig is wrong, and that is for the caller to say. Where nothing known moves it, what is left of the
    recording is noise, from whose rounding no fit should be drawn.

    Args:
        campaign: of these records.
        records: as `read_records` gives them.

    Returns:
        The campaign, with those in its `left_out`, and the other records.
    """
    left = []
    for record in records:
        if not isinstance(record, OpenRecord):
            continue
        simulated = simulated_series(record, lanes_of(record, [NOMINAL]))[0]
        if not np.isfinite(simulated).all():
            left.append(LeftOut(record.name, "the nominal rig touches down in its simulation", INSTEAD))
        elif _rests(record, simulated[0]):
            left.append(LeftOut(record.name, STILL, EXCITE))
    names = {one.recording for one in left}
    kept = tuple(r for r in records if r.name not in names)
    if not names or not any(r.role == "fit" for r in kept):
        return campaign, tuple(records)
    specs = tuple(spec for spec in campaign.recordings if spec.name not in names)
    return replace(campaign, recordings=specs, left_out=(*campaign.left_out, *left)), kept


def _rests(record: OpenRecord, simulated: np.ndarray) -> bool:
    """Whether the simulated displacement (axes, samples) is nothing beside the recorded one, in every window."""

    def power(series: np.ndarray) -> np.ndarray:
        return np.abs(record.coordinates(series).reshape(len(series), record.windows.count, -1)) ** 2

    moved, recorded = power(simulated).sum(axis=(0, 2)), power(record.series["displacement"]).sum(axis=(0, 2))
    return bool((moved < QUIET * recorded).all())
