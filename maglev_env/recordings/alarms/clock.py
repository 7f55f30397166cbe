"""What time stamps tell of missing and double samples."""

import numpy as np

from maglev_env.recordings.alarms.alarm import Alarm
from maglev_env.recordings.formats.time_stamps import Clock
from maglev_env.recordings.masking import MOST_MASKED


def clock_alarms(clock: Clock, rate: float, start: int = 0) -> list[Alarm]:
    """What the time stamps tell of missing and double samples."""
    found, size = [], clock.kept.size
    if clock.backward is not None:
        at = clock.backward
        text = f"time runs backward after {at / rate:.4g} s (sample {start + at}); cut the record there: samples = {at}"
        found.append(Alarm("samples", "time", at / rate, text, "refuse"))
    if clock.gaps:
        at, missing = clock.gaps[0]
        total = sum(lost for _, lost in clock.gaps)
        when = float(clock.instants[at]) / rate if clock.instants is not None else at / rate
        edges = [0, *[i + 1 for i, _ in clock.gaps], size]
        longest = int(np.argmax(np.diff(edges)))
        are = "samples are" if missing > 1 else "sample is"
        text = (
            f"{missing} {are} missing after {when:.4g} s (sample {start + at}), {total} in all in "
            f"{len(clock.gaps)} gaps ({total / (size + total):.2%})"
        )
        few = total <= MOST_MASKED * (size + total)
        cut = f"; use start = {start + edges[longest]}, samples = {edges[longest + 1] - edges[longest]}"
        text += "; they are bridged and masked" if few else cut
        stretch = None if few else (start + edges[longest], edges[longest + 1] - edges[longest])
        found.append(Alarm("samples", "time", when, text, "warning" if few else "refuse", stretch))
    if clock.repeated:
        at, few = clock.repeated[0], len(clock.repeated) <= MOST_MASKED * size
        text = f"{len(clock.repeated)} time stamps repeat, the first at {at / rate:.4g} s (sample {start + at})"
        text += "; these samples are left out" if few else "; record again"
        found.append(Alarm("samples", "time", at / rate, text, "warning" if few else "refuse"))
    return found
