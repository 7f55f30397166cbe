"""Read every recording of a campaign: those that tell nothing are left out with a reason, and the others are used."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TypeVar

from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.left_out import LeftOut, NoneTells, TellsNothing

Read = TypeVar("Read")


def each_recording(
    campaign: Campaign,
    read: Callable[[RecordingSpec], Read],
    track: Callable[[Iterable[RecordingSpec]], Iterable[RecordingSpec]] = iter,
) -> tuple[Campaign, list[Read]]:
    """What is read of every recording that tells something.

    Args:
        campaign: with the recordings.
        read: reads one of them; raises `TellsNothing` for one that is to be left out.
        track: wraps the loop over the recordings, to show progress.

    Returns:
        The campaign of those that were read, the others in its `left_out`; and what `read` gave, in order.

    Raises:
        TellsNothing, NoneTells: None of them tells anything.
    """
    kept, found, left = [], [], []
    for spec in track(campaign.recordings):
        try:
            found.append(read(spec))
        except TellsNothing as nothing:
            left.append(LeftOut(spec.name, nothing.reason, nothing.instead))
        else:
            kept.append(spec)
    check_left(campaign, left, bool(kept))
    return replace(campaign, recordings=tuple(kept), left_out=(*campaign.left_out, *left)), found


def check_left(campaign: Campaign, left: Iterable[LeftOut], enough: bool) -> None:
    """Refuse a campaign of which too little is left.

    Raises:
        TellsNothing, NoneTells: Not `enough` is left; the message has the reason of every recording that was left out.
    """
    if enough:
        return
    left = list(left)
    if len(campaign.recordings) == len(left) == 1:
        raise TellsNothing(left[0].reason, left[0].instead, campaign.folder / left[0].recording)
    alike: dict[tuple[str, str], list[str]] = {}
    for one in left:
        alike.setdefault((one.reason, one.instead), []).append(one.recording)
    reasons = [str(LeftOut(", ".join(files), *why)) for why, files in alike.items()]
    raise NoneTells(f"{campaign.folder}: no recording to fit tells anything: {' | '.join(reasons)}")
