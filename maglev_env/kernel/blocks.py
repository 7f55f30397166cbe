"""Experiments in lanes: blocks of up to LANES of one structure, with the constants that the kernel takes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.kernel.fine_steps import steps_on_effects, steps_on_stiffness
from maglev_env.kernel.lanes import LaneBatch, lane_batch, structural, structure_of, timing_of
from maglev_env.kernel.structure import Structure
from maglev_lanes.layout import LANES


@dataclass(frozen=True)
class Block:
    """Up to LANES experiments of one structure.

    Args:
        batch: inputs of the kernel.
        members: (n,), which of the experiments they are.
        force_noise: of each lane, N.
        experiments: they.
        substeps: integration steps per control sample.
    """

    batch: LaneBatch
    members: np.ndarray
    force_noise: np.ndarray
    experiments: tuple[Experiment, ...]
    substeps: int

    @property
    def experiment(self) -> Experiment:
        """One of them."""
        return self.experiments[0]


def prepared(experiments: Sequence[Experiment], substeps: int = 1) -> list[Block]:
    """Lanes for `steady_spectra` and `replayed`: the constants of experiments that do not depend on gains, excitations
    and offset. As many as possible share blocks.

    Args:
        experiments: of one rig.
        substeps: least number of integration steps per control sample.
    """
    return blocks_of(experiments, max(substeps, steps_on_stiffness(experiments[0])), joint=True)


def own_lanes(experiments: Sequence[Experiment]) -> list[Block]:
    """Lanes of experiments under their own gains, which serve several simulations.

    Raises:
        ValueError: As `simulate_statistics`.
    """
    common(experiments)
    return blocks_of(experiments, 1)


def common(experiments: Sequence[Experiment]) -> Experiment:
    """One of several experiments that share all but gains, effects, rig and seed.

    Raises:
        ValueError: They do not, or there is none.
    """
    if not experiments:
        raise ValueError("give at least one experiment")
    first = experiments[0]

    def schedule(e: Experiment) -> tuple:
        rates = e.rig.control_rate, e.recorded_rate
        return e.excitations, e.periods, e.transient_periods, e.offset, e.rig.axes, rates, e.sensor == "probe"

    if any(schedule(e) != schedule(first) for e in experiments):
        raise ValueError("experiments in one batch must share excitations, periods, offset, axes, rates and sensor")
    return first


def blocks_of(experiments: Sequence[Experiment], substeps: int, joint: bool = False, every: int = 1) -> list[Block]:
    """Blocks of up to LANES experiments of one structure each, so that a lane never depends on its neighbours.

    Args:
        experiments: the experiments.
        substeps: least number of integration steps per control sample; effects may need more.
        joint: whether lanes of any gains and effects share blocks.
        every: their number is a multiple of this one.
    """
    groups: dict[tuple[Structure, tuple[int, ...], int], list[int]] = {}
    known: dict[tuple, tuple[Structure, tuple[int, ...], int]] = {}
    for i, e in enumerate(experiments):
        if (key := structural(e)) not in known:
            own, fine = structure_of(e), -(-max(substeps, steps_on_effects(e)) // every) * every
            known[key] = own.joint if joint else own, timing_of(e, fine), fine
        groups.setdefault(known[key], []).append(i)
    blocks = []
    for (structure, _, fine), members in groups.items():
        batch = lane_batch([experiments[i] for i in members], fine, structure)
        for start in range(0, len(members), LANES):
            s = slice(start, start + LANES)
            part = replace(batch, rows=batch.rows[:, s], seeds=batch.seeds[..., s])
            noise = [experiments[i].rig.noise.force for i in members[s]]
            noise += noise[-1:] * (LANES - len(noise))
            own = tuple(experiments[i] for i in members[s])
            blocks.append(Block(part, np.array(members[s]), np.array(noise), own, fine))
    return blocks
