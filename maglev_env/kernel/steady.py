"""Spectra of prepared lanes in the steady state of periodic waves, of several recordings at once."""

from collections.abc import Sequence

import numpy as np

from maglev_env.experiment import sampling
from maglev_env.kernel.driven import Drive, Driven, driven
from maglev_env.kernel.blocks import Block
from maglev_env.kernel.state import State, stretches
from maglev_lanes.layout import LANES
from maglev_lanes.line_spectra import LineSpectra
from maglev_lanes.period_statistics import as_complex
from maglev_lanes.threads import over_threads


def steady_spectra(
    lanes: Sequence[Block],
    drives: Sequence[Drive],
    lines: Sequence[np.ndarray],
    transient: int,
    periods: int = 1,
    currents: bool = True,
    threads: int | None = None,
) -> list[np.ndarray]:
    """Complex amplitudes of displacement and current under periodic waves.

    Args:
        lanes: see `simulate.prepared`.
        drives: recordings of the same period and rates; their waves are one period, (axes, samples_per_period), and the
            reference includes the offset.
        lines: harmonic numbers of each recording, (lines,).
        transient: number of control samples before the periods.
        periods: number of periods in the mean.
        currents: False leaves the currents out.
        threads: as for `simulate_statistics`.

    Returns:
        Of each recording (n, 1 + currents, axes, lines), means over the periods; nan after a touchdown.
    """
    first = drives[0].experiment
    _, every = sampling(first.recorded_rate, first.rig.control_rate)
    count, n, axes = sum(len(b.members) for b in lanes), first.samples_per_period, first.rig.axes
    spectra = [np.full((count, 1 + currents, axes, len(own)), np.nan, complex) for own in lines]
    whole = np.stack([d.stacked for d in drives], axis=1)  # (3, drives, axes, samples)
    before = [whole] * (transient // n)
    if transient % n:
        before.insert(0, whole[..., n - transient % n :])
    schedule = [[part.reshape(-1) for part in waves] for waves in [*before, *[whole] * periods]]

    asked = np.unique(np.concatenate(lines))
    at_lines = LineSpectra(len(range(0, n, every)), asked)

    def run(own: Driven) -> None:
        state = State(own.block)
        written = len(own.block.batch.structure.channels)
        channels = [0, written - 1][: 1 + currents]  # the current is the last one
        total: np.ndarray | None = None
        for out in stretches(own.block, state, schedule, silent=len(before), waves=len(drives)):
            if total is None:
                total = out if periods == 1 else out.copy()
            else:
                total += out
        if total is None:
            return
        series = np.ascontiguousarray(total[::every]).reshape(-1, axes * written, LANES)
        found = [[as_complex(at_lines(series, axis * written + c)) for axis in range(axes)] for c in channels]
        alive = state.alive()
        for d, places in own.places():
            kept = places[alive[places]]
            of_lanes = np.array(found)[:, :, kept][..., np.searchsorted(asked, lines[d])] / periods
            spectra[d][own.member[kept]] = of_lanes.transpose(2, 0, 1, 3)

    for _ in over_threads(run, driven(lanes, drives), threads):
        pass
    return spectra
