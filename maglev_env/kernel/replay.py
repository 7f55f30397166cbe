"""Run prepared lanes under waves of any length: what drove recordings that never repeat."""

from collections.abc import Callable, Sequence

import numpy as np

from maglev_env.kernel.driven import Drive, Driven, driven
from maglev_env.kernel.blocks import Block
from maglev_env.kernel.state import State, put_lanes, stretches
from maglev_env.loop.mechanics import STEPS
from maglev_lanes.layout import row
from maglev_lanes.threads import over_threads

STRETCH = 4096  # control samples that one call of the kernel advances
# Takes the index of a drive, that of a lane and the lane's series (3, axes, samples), which are overwritten later.
Look = Callable[[int, int, np.ndarray], None]


def replayed(lanes: Sequence[Block], drives: Sequence[Drive], threads: int | None = None) -> list[np.ndarray]:
    """Displacement readings, coil currents and commands of lanes from rest, at the control rate.

    Args:
        lanes: see `simulate.prepared`.
        drives: recordings of any length; one whose ticks have instants of their own is alone.
        threads: None for all cores.

    Returns:
        Of each recording (n, 3, axes, samples); nan for a lane that touched down.
    """
    count = sum(len(block.members) for block in lanes)
    found = [np.empty((count, *d.stacked.shape)) for d in drives]

    def look(drive: int, lane: int, series: np.ndarray) -> None:
        found[drive][lane] = series

    look_at_replays(lanes, drives, look, threads)
    return found


def look_at_replays(lanes: Sequence[Block], drives: Sequence[Drive], look: Look, threads: int | None = None) -> None:
    """As `replayed`, but every lane is looked at when its block is done, so that few series are in memory."""
    axes = drives[0].stacked.shape[1]
    longest = max(d.samples for d in drives)
    # A recording that ends before another one goes on as it ended; what its lanes do then is not looked at.
    whole = np.stack([np.pad(d.stacked, ((0, 0), (0, 0), (0, longest - d.samples)), "edge") for d in drives], axis=1)
    schedule = [[part.ravel() for part in whole[..., at : at + STRETCH]] for at in range(0, longest, STRETCH)]

    def run(own: Driven) -> None:
        block, state = own.block, State(own.block)
        series, every = np.full((len(own.member), 3, axes, longest), np.nan), np.arange(len(own.member))
        spans = drives[0].spans(block.substeps)
        for i, out in enumerate(stretches(block, state, schedule, waves=len(drives), spans=spans)):
            stretch = slice(i * STRETCH, min((i + 1) * STRETCH, longest))
            # A shorter last stretch fills the start of the buffer. The current is the last channel.
            kept = out[: stretch.stop - stretch.start, :, [0, -1, 1], : len(own.member)]
            put_lanes(kept, series[..., stretch], every)
        steps = state.rows[row(STEPS)]
        stood = np.searchsorted(np.cumsum(spans), steps, "right") if spans.size else steps / block.substeps
        lasted = np.where(state.alive(), np.inf, stood)
        for lane, (d, member) in enumerate(zip(own.drive, own.member, strict=True)):
            one = series[lane, ..., : drives[d].samples]
            if lasted[lane] < drives[d].samples:
                one[:] = np.nan
            look(int(d), int(member), one)

    for _ in over_threads(run, driven(lanes, drives), threads):
        pass
