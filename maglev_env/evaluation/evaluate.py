"""Scoring of gain sets as on a real rig: simulate the identification experiment, estimate, score."""

from collections.abc import Callable, Sequence

import numpy as np

from maglev_env.design.goals import goal_of
from maglev_env.evaluation.devices import Prepared, simulated_groups
from maglev_env.evaluation.evaluation import Evaluation, joined
from maglev_env.evaluation.judging import Elsewhere, Judged
from maglev_env.evaluation.score import ScoreTarget, stacked
from maglev_env.evaluation.target import score_target
from maglev_env.evaluation.worst import drawn_experiments
from maglev_env.experiment import Experiment
from maglev_env.kernel.blocks import own_lanes
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import axis_rig
from maglev_lanes.shared_pool import SharedPool
from maglev_lanes.threads import cores, one_ahead, over_threads

CHUNK = 128  # experiments estimated together, which keeps the largest temporary near 10 MB per thread
LONGER = 2  # times as many: 40 MB in all for a chunk of the full protocol, whatever the number of gain sets


def evaluate(
    experiments: Sequence[Experiment],
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
    targets: Sequence[ScoreTarget] | None = None,
    bands: np.ndarray | None = None,
    device: str = "cpu",
    judges: SharedPool | None = None,
) -> Evaluation:
    """Simulate, estimate and score experiments of one kind of rig; gains, parameters, effects and seeds may differ.

    What the score is of is the goal of the first rig, see `design.goals.with_goal`; its `match` uses the targets.

    Args:
        experiments: The experiments.
        threads: Number of threads, by default all cores; results do not depend on it.
        progress: Called with the number of experiments done.
        targets: One per experiment, for every axis; by default that of the first rig.
        bands: Bands (b, 2), Hz; by default the sliding ones of the first rig's protocol.
        device: One of DEVICES, where the identification experiments are simulated. On a GPU sums are rounded in
            another way, so results differ from those of a processor in the last digits.
        judges: Processes that judge what a GPU simulated, in place of threads; results do not depend on it.

    Raises:
        ValueError: The experiments do not share excitations and schedule, or lack a force or a current excitation; or
            the device is not there, or cannot simulate them.
    """
    if not experiments:
        raise ValueError("give at least one experiment")
    rig = experiments[0].rig
    for place in ("force", "current"):
        if not lines_at(experiments[0].excitations, place).size:
            raise ValueError(
                f"rig {rig.name}: nothing is excited at the {place}, and a gain set is judged by lines at force and "
                "current" + ("" if rig.controlled else "; nothing controls this rig: simulate and estimate a recording")
            )
    goal = goal_of(rig)
    if targets is None:
        per_axis = [[score_target(axis_rig(rig, axis))] * len(experiments) for axis in range(rig.axes)]
    elif len(targets) != len(experiments):
        raise ValueError(f"{len(targets)} targets for {len(experiments)} experiments: give one for each")
    else:
        per_axis = [list(targets)] * rig.axes
    # Where every thread has one, longer chunks save a tenth of the quick protocol, which is what numpy takes to begin.
    longer = device == "cpu" and len(experiments) >= LONGER * CHUNK * (threads or cores())
    size = LONGER * CHUNK if longer else CHUNK
    chunks = [slice(i, i + size) for i in range(0, len(experiments), size)]
    parts = []

    def prepared(chunk: slice) -> list[Prepared]:
        drawn = drawn_experiments(experiments[chunk], goal.rigs) if goal else []
        return [Prepared(part, own_lanes(part)) for part in (experiments[chunk], *drawn)]

    def how(chunk: slice) -> Judged:
        return Judged([stacked(one[chunk]) for one in per_axis], bands, goal)

    def done(part: Evaluation) -> None:
        parts.append(part)
        if progress:
            progress(len(part.score))

    if device == "cpu":
        for part in over_threads(lambda chunk: how(chunk)(prepared(chunk)), chunks, threads):
            done(part)
    else:
        for group in one_ahead(simulated_groups(chunks, prepared, device, judges.empty if judges else np.empty)):
            sent = [Elsewhere.of(made, how(chunk), judges) for chunk, made in group] if judges else [None]
            if judges is None or None in sent:
                found = over_threads(lambda pair: how(pair[0])(pair[1]), group, threads)
            else:
                found = judges.map(Elsewhere.judge, sent)
            for part in found:
                done(part)
            if judges:
                judges.forget({name for one in sent if one for name in one.names()})
    return joined(parts, np.concatenate)
