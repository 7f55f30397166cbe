"""Recordings in whose simulation the nominal rig falls, although the recorded rotor did not."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from maglev_env.recordings.campaign import Campaign
from maglev_env.recordings.left_out import LeftOut
from sim2real.compared.simulated import Point, lanes_of
from sim2real.recorded.open_evidence import simulated_series
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record

INSTEAD = "record less motion, or look at this recording alone: `maglev diagnose` asks what would make it stand"


def standing(
    campaign: Campaign, records: Sequence[Record | OpenRecord]
) -> tuple[Campaign, tuple[Record | OpenRecord, ...]]:
    """Leave out recordings without a period in whose simulation the nominal rig falls, if others to fit stand.

    A fit that begins at the nominal rig would be lost in all recordings for the sake of one. Where it falls in all of
    them, the nominal rig is wrong, and that is for the caller to say.

    Args:
        campaign: of these records.
        records: as `read_records` gives them.

    Returns:
        The campaign, with those in its `left_out`, and the other records.
    """
    left = []
    for record in records:
        if isinstance(record, OpenRecord) and _falls(record):
            left.append(LeftOut(record.name, "the nominal rig touches down in its simulation", INSTEAD))
    names = {one.recording for one in left}
    kept = tuple(r for r in records if r.name not in names)
    if not names or not any(r.role == "fit" for r in kept):
        return campaign, tuple(records)
    specs = tuple(spec for spec in campaign.recordings if spec.file not in names)
    return replace(campaign, recordings=specs, left_out=(*campaign.left_out, *left)), kept


def _falls(record: OpenRecord) -> bool:
    """Whether the nominal rig touches down in a record's simulation."""
    return not np.isfinite(simulated_series(record, lanes_of(record, [Point({}, {})]))).all()
