"""Prepared lanes under the gains and waves of several recordings at once: every recording of every lane is a lane.

A block of the kernel costs the same with one lane as with all, so few hypotheses of many recordings share blocks.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.kernel.controllers import with_controllers
from maglev_env.kernel.layout import AXIS, LOADED, WAVE
from maglev_env.kernel.state import REGULAR
from maglev_env.kernel.blocks import Block
from maglev_lanes.layout import LANES, row


@dataclass(frozen=True)
class Drive:
    """What a recording runs under.

    Args:
        experiment: gives gains, period and recorded rate; its structure (see `structure_of`) must be that of the lanes,
            except for effects.
        waves: (axes, samples) of "force" (N), "current" (A, added to the command) and "reference" (m), at the control
            rate.
        instants: (samples,), when each control sample is, in control steps; None: one step after another.
        load: constant force (axes,), N, that pushes the lane of an experiment beside the waves; None: none.
    """

    experiment: Experiment
    waves: Mapping[str, np.ndarray]
    instants: np.ndarray | None = None
    load: Callable[[Experiment], np.ndarray] | None = None

    @cached_property
    def stacked(self) -> np.ndarray:
        """Force, injection and reference, (3, axes, samples)."""
        return np.stack([np.atleast_2d(self.waves[place]) for place in ("force", "current", "reference")])

    @property
    def samples(self) -> int:
        return self.stacked.shape[-1]

    def spans(self, substeps: int) -> np.ndarray:
        """Integration steps (samples,) of every control sample, with `substeps` in a control step; empty: all alike.

        A tick is moved to the nearest integration step.
        """
        if self.instants is None:
            return REGULAR
        edges = np.rint((self.instants - self.instants[0]) * substeps).astype(np.int64)
        return np.diff(edges, append=edges[-1] + substeps)


@dataclass(frozen=True)
class Driven:
    """A block of lanes that run under several drives.

    Args:
        block: the lanes.
        drive: (lanes,), index of each lane's drive.
        member: (lanes,), index of each lane among the prepared ones.
    """

    block: Block
    drive: np.ndarray
    member: np.ndarray

    def places(self) -> list[tuple[int, np.ndarray]]:
        """Every drive of the block with its lanes."""
        return [(int(d), np.flatnonzero(self.drive == d)) for d in np.unique(self.drive)]


def driven(lanes: Sequence[Block], drives: Sequence[Drive]) -> list[Driven]:
    """Blocks of all prepared lanes under all drives.

    Args:
        lanes: see `simulate.prepared`.
        drives: of the same controller kind, rates, axes and instants.
    """
    groups: dict[tuple, list[Block]] = {}
    for b in lanes:
        key = b.batch.structure, b.batch.timing.tobytes(), b.batch.history_length, b.substeps
        groups.setdefault(key, []).append(b)
    found = []
    for blocks in groups.values():
        first, structure = blocks[0], blocks[0].batch.structure
        member = np.concatenate([b.members for b in blocks])
        rows = np.concatenate([b.batch.rows for b in blocks], axis=1)
        seeds = np.concatenate([b.batch.seeds for b in blocks], axis=2)
        under = [with_controllers(rows, structure, d.experiment.gains, d.experiment) for d in drives]
        experiments = [e for b in blocks for e in b.experiments]
        for i, (own, d) in enumerate(zip(under, drives, strict=True)):
            own[row(WAVE)] = i
            if d.load is not None:
                rows_of = [row(LOADED) + axis * row(AXIS) for axis in range(d.experiment.rig.axes)]
                own[rows_of] = np.transpose([d.load(e) for e in experiments])
        of_drive = np.repeat(np.arange(len(drives)), member.size)
        every, members = np.concatenate(under, axis=1), np.tile(member, len(drives))
        every_experiment = experiments * len(drives)
        every_seed = np.tile(seeds, len(drives))
        batch = replace(first.batch, structure=replace(structure, own_waves=True))
        for start in range(0, members.size, LANES):
            at = slice(start, start + LANES)
            part = replace(batch, rows=every[:, at], seeds=every_seed[..., at])
            block = replace(first, batch=part, members=members[at], experiments=tuple(every_experiment[at]))
            found.append(Driven(block, of_drive[at], members[at]))
    return found
