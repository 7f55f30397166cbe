"""Run prepared lanes under waves of any length: what drove a recording that never repeats."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.kernel.controllers import with_controllers
from maglev_env.kernel.simulate import _Block, _periods, _State
from maglev_lanes.layout import LANES
from maglev_lanes.threads import over_threads

STRETCH = 4096  # control samples that one call of the kernel advances


def replayed(
    lanes: Sequence[_Block], experiment: Experiment, waves: Mapping[str, np.ndarray], threads: int | None = None
) -> np.ndarray:
    """Displacement readings, coil currents and commands of lanes from rest, at the control rate.

    Args:
        lanes: see `simulate.prepared`; they run under the gains of the experiment.
        experiment: whose structure but for effects must be that of the lanes.
        waves: (axes, samples) of "force" (N), "current" (A, added to the command) and "reference" (m).
        threads: None for all cores.

    Returns:
        (n, 3, axes, samples); nan for a lane that touched down.
    """
    driven = [np.atleast_2d(waves[place]) for place in ("force", "current", "reference")]
    axes, samples = driven[0].shape
    schedule = [[w[:, at : at + STRETCH].ravel() for w in driven] for at in range(0, samples, STRETCH)]
    count = sum(len(block.members) for block in lanes)
    found = np.full((count, 3, axes, samples), np.nan)

    def run(prepared: _Block) -> None:
        structure = prepared.batch.structure
        rows = with_controllers(prepared.batch.rows, structure, experiment.gains, experiment)
        block = replace(prepared, batch=replace(prepared.batch, rows=rows), experiment=experiment)
        state = _State(block)
        outputs = len(structure.channels)
        for i, out in enumerate(_periods(block, state, schedule, outputs)):
            stretch = slice(i * STRETCH, min((i + 1) * STRETCH, samples))
            # A shorter last stretch fills the start of the same buffer.
            filled = (axes, outputs, LANES, stretch.stop - stretch.start)
            kept = out.reshape(-1)[: np.prod(filled)].reshape(filled)[:, [0, outputs - 1, 1], : len(block.members)]
            found[block.members, ..., stretch] = kept.transpose(2, 1, 0, 3)
        found[block.members[~state.alive()[: len(block.members)]]] = np.nan

    for _ in over_threads(run, lanes, threads):
        pass
    return found
