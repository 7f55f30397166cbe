"""What the lanes of a GPU give in numba's simulator: NUMBA_ENABLE_CUDASIM=1 python gpu_in_simulator.py RESULTS.

It must run in a process of its own, because the simulator is chosen before numba is imported.
"""

import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from maglev_env.evaluation import evaluate
from maglev_env.evaluation.judging import ready
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.blocks import Block, own_lanes
from maglev_env.kernel.gpu import gathered_on_gpu
from maglev_env.kernel.simulate import simulate_statistics
from maglev_env.loop.effect import parse_effects
from maglev_env.rig.rig_file import load_rig
from maglev_lanes.shared_pool import SharedPool, shared_pool

CASES = {
    "one axis": ("hmb_free", ()),
    "delay": ("hmb_free", ("delay=2e-4",)),  # of several samples
    "all effects": ("hmb_free", ("deadband=1e-3", "dropped_samples=0.1", "runout=1e-6", "friction=0.01")),
    "x-y": ("hmb_radial", ()),
    "x-y coupled": ("hmb_radial", ("cross_coupling=0.05",)),
}
FUNDAMENTAL = 400.0  # Hz: a period has 50 samples
LOST = 1  # the experiment of a case whose rotor touches down
COUNT = 17  # experiments of the first case: more than a block
JUDGED = 5  # of them, by whom estimates are compared


def experiments(case: str) -> list[Experiment]:
    """Short experiments of unlike gains and seeds, of which one is unstable."""
    rig, effects = CASES[case]
    first = protocol_experiment(load_rig(rig), None, parse_effects(list(effects)))
    count = len(first.excitations)
    excitations = tuple(
        replace(e, fundamental=FUNDAMENTAL, lines=tuple(range(i + 1, 4 * count + 1, count)))
        for i, e in enumerate(first.excitations)
    )
    first = replace(first, excitations=excitations, periods=2, transient_periods=1)
    own = first.gains[0] if isinstance(first.gains, tuple) else first.gains
    found = []
    for i in range(COUNT if case == "one axis" else 2):
        gains = replace(own, kp=own.kp * (1 - 6 * (i == LOST)), kd=own.kd * (1 + 0.01 * i))
        found.append(replace(first, gains=gains, seed=(3, i)))
    return found


def figures(of: list[Experiment], blocks: list[Block], **gathered: object) -> dict[str, np.ndarray]:
    """Arrays of what was simulated."""
    done = simulate_statistics(of, threads=1, blocks=blocks, **gathered)
    names = ("touchdown_time", "peak_displacement", "current_rms")
    return {"mean": done.statistics.mean, "covariance": done.statistics.covariance} | {
        name: getattr(done, name) for name in names
    }


def judged(of: list[Experiment], device: str, judges: SharedPool | None = None) -> dict[str, np.ndarray]:
    """Arrays of what was estimated of experiments of one axis, in one band that holds all lines."""
    wide = (0.5 * FUNDAMENTAL, 8.5 * FUNDAMENTAL)
    own = [replace(e, rig=replace(e.rig, target=replace(e.rig.target, band=wide))) for e in of]
    done = evaluate.evaluate(own, threads=1, bands=np.array([wide]), device=device, judges=judges)
    return {name: getattr(done, name) for name in ("stiffness", "damping_high", "score", "feasible")} | done.margins


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # plain numbers say so when the arithmetic of the noise overflows, as it is to do
    results = {}
    for case in CASES:
        own = experiments(case)
        blocks = own_lanes(own)
        for name, most in (("", None), (" in parts", 1)) if case == "one axis" else (("", None),):
            found = figures(own, blocks, gathered=list(gathered_on_gpu(blocks, most)))
            results |= {f"{case}{name}/{key}": values for key, values in found.items()}
    evaluate.CHUNK = 2  # of experiments that are judged together: several chunks, which end within blocks
    own = experiments("one axis")[:JUDGED]
    results |= {f"judged/{key}": values for key, values in judged(own, "cuda").items()}
    with shared_pool(2, ready) as pool:
        for turn in ("apart", "again"):  # the second time in the memory of the first
            found = judged(own, "cuda", pool)
            results |= {f"{turn}/{key}": values for key, values in found.items()}
        results["memories"] = len(pool.memories)
    np.savez(Path(sys.argv[1]), **results)
