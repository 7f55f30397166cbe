"""Small motions of x-y loops, checked against the linear loop at every line."""

from dataclasses import replace

import numpy as np
from planar_rigs import COUPLED, GAINS

from maglev_env.experiment import Experiment, without_noise
from maglev_env.kernel.simulate import simulate_statistics
from maglev_env.linear.expected import expected_statistics
from maglev_env.rig.excitation import Excitation


def small(rig=COUPLED, gains=GAINS, lines=(2, 6, 10, 16), **changes):
    """20 ms periods, 1 nm of motion: force, injection and reference in oblique directions."""
    excitations = (
        Excitation("sphs", "force", 50.0, tuple(range(1, 20, 2)), 1e-4, direction=30.0),
        Excitation("sphs", "current", 50.0, lines, 1e-5, direction=-50.0),
        Excitation("multisine", "reference", 50.0, (4, 8, 12), 1e-9, seed=1, direction=160.0),
    )
    e = without_noise(Experiment(rig, gains, excitations, periods=2, transient_periods=60))
    return replace(e, **changes)


def check_every_line(e):
    got = simulate_statistics([e]).statistics
    expected = expected_statistics(e, got.lines)
    assert got.channels == expected.channels
    for channel in got.channels:
        error = np.abs(got.amplitude(channel)[0] - expected.amplitude(channel))
        assert (error <= 1e-5 * np.abs(expected.amplitude(channel))).all(), channel
