"""In what the recordings of a campaign differ already: there is no need to ask for that again."""

from collections.abc import Sequence

import numpy as np

from sim2real.compared.reached import moved
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record

LOUDER = 1.8  # times the motion of a recording that of another one with another amplitude
AT_REST = 0.05  # share of the largest motion below which nothing drives a recording
ELSEWHERE = 0.05  # share of the gap between the means of two recordings at different places


def made_already(records: Sequence[Record | OpenRecord]) -> frozenset[str]:
    """Kinds of change (see `recording_menu.Item`) among recordings: "amplitude", "offset" and "gains"."""
    motions = np.array([moved(r) for r in records])
    driven = motions[motions >= AT_REST * motions.max()]
    means = np.array([r.series["displacement"].mean(axis=1) for r in records])
    found = set()
    if driven.max() >= LOUDER * driven.min():
        found.add("amplitude")
    if np.ptp(means, axis=0).max() >= ELSEWHERE * records[0].nominal.gap:
        found.add("offset")
    if any(r.experiment.gains != records[0].experiment.gains for r in records):
        found.add("gains")
    return frozenset(found)
