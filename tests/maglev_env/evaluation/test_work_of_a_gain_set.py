"""How much the interpreter does for a gain set, counted: a time would tell what else a machine does."""

import sys
from dataclasses import replace

import numpy as np

from maglev_env.evaluation.evaluate import CHUNK, LONGER, evaluate
from maglev_env.experiment import protocol_experiment
from maglev_env.loop.gains import with_gains
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.protocol import env_protocol

FREE = load_rig("hmb_free")
# Calls of Python's and numpy's functions for one gain set, among as many as a sweep evaluates at a time: 200 when this
# was written. What is done for each gain set by itself, or for each of those with some feature, takes hundreds: a look
# at the loops with a narrow pole one by one took 1,300, and three quarters of a sweep's time.
MOST = 250


def calls(work):
    """Number of function calls, of Python and of C, that some work makes."""
    counted = 0

    def count(frame, event, function):
        nonlocal counted
        counted += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        work()
    finally:
        sys.setprofile(None)
    return counted


def test_gain_sets_of_a_sweep_are_judged_together():
    quick, rng, n = replace(FREE, protocol=env_protocol(FREE, "quick")), np.random.default_rng(1), LONGER * CHUNK
    drawn = {name: np.exp(rng.uniform(*np.log(ends), n)) for name, ends in FREE.bounds.items()}
    experiments = [
        protocol_experiment(
            quick, with_gains(quick.gains, **{name: float(values[i]) for name, values in drawn.items()})
        )
        for i in range(n)
    ]
    evaluate(experiments, threads=1)  # imports, compiles, and works out the rig
    assert calls(lambda: evaluate(experiments, threads=1)) < MOST * n
