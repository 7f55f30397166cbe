"""The rotor kernel: one compiled loop that steps LANES free rotors under digital control, in five degrees of freedom.

As the axis kernel: flat arrays with LANES consecutive values per variable, scalar pieces, constant offsets, no
branches, so that loops over lanes become full-width vector instructions.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from maglev_env.rotor.pieces import advance
from maglev_env.rotor.rows import (
    CHANNELS, COMMAND, COS, COUNT_MAX, COUNTS, CURRENT, D, DECAY_D, DECAY_I, INTO, KD, KI, KP, LANES, NOISE, OUT,
    PER_COUNT, PER_U, PROBE, Q, SIN, U_COUNT, U_MAX, XI,
)  # fmt: skip
from maglev_lanes.compiled import compiled
from maglev_lanes.noise import drawn

W = LANES
TILE = 8  # samples gathered before they are written out lane by lane


@cache
def kernel(substeps: int = 1) -> Callable[..., None]:
    """The compiled stepper, of so many integration steps per control sample.

    Called as step(block, seeds, first_sample, h, force, injection, tile, out), all arrays flat: advances the block over
    the samples of force (5, n) generalised forces (N, N m) and injection (4, n) A added to the commands, both held;
    fills out (channels, LANES, n); tile is scratch (TILE channels LANES); h is the integration step in s.
    """
    return _make(substeps)


def _make(substeps):
    sources, channels = 0, len(CHANNELS)  # sources: see `compiled`
    width = channels * W

    def step(x, seeds, first_sample, h, force, injection, tile, out):
        if sources == 0:
            return
        samples = injection.size // 4
        for t in range(samples):
            o = (t % TILE) * width
            count = np.uint64(np.int64(first_sample + t + 1))
            for q in range(4):
                for i in range(W):
                    sensed = x[(PROBE + q) * W + i] + x[NOISE * W + i] * drawn(seeds[q * W + i], count)
                    counts = np.rint(sensed * x[COUNTS * W + i])
                    top = x[COUNT_MAX * W + i]
                    tile[o + q * W + i] = min(max(counts, -top), top) * x[PER_COUNT * W + i]
                    tile[o + (4 + q) * W + i] = x[(CURRENT + q) * W + i]
            for i in range(W):
                tile[o + 8 * W + i] = x[(Q + 4) * W + i]
            for d in range(2):
                for i in range(W):
                    a, b = tile[o + d * W + i], tile[o + (2 + d) * W + i]
                    e = -(x[INTO * W + i] * a + x[(INTO + 1) * W + i] * b)
                    e_2 = -(x[(INTO + 2) * W + i] * a + x[(INTO + 3) * W + i] * b)
                    # Controller c acts with kp e + kd (e - d) / td + ki xi, as the axis kernel's.
                    c, c_2 = d * W + i, (2 + d) * W + i
                    lag, lag_2 = e - x[D * W + c], e_2 - x[D * W + c_2]
                    xi, xi_2 = x[XI * W + c], x[XI * W + c_2]
                    u = x[KP * W + c] * e + x[KD * W + c] * lag + x[KI * W + c] * xi
                    u_2 = x[KP * W + c_2] * e_2 + x[KD * W + c_2] * lag_2 + x[KI * W + c_2] * xi_2
                    x[D * W + c], x[D * W + c_2] = e - lag * x[DECAY_D * W + c], e_2 - lag_2 * x[DECAY_D * W + c_2]
                    x[XI * W + c] = e + (xi - e) * x[DECAY_I * W + c]
                    x[XI * W + c_2] = e_2 + (xi_2 - e_2) * x[DECAY_I * W + c_2]
                    first = x[OUT * W + i] * u + x[(OUT + 1) * W + i] * u_2 + injection[d * samples + t]
                    second = x[(OUT + 2) * W + i] * u + x[(OUT + 3) * W + i] * u_2 + injection[(2 + d) * samples + t]
                    top, per, lsb = x[U_MAX * W + i], x[PER_U * W + i], x[U_COUNT * W + i]
                    x[COMMAND * W + c] = min(max(np.rint(first * per), -top), top) * lsb
                    x[COMMAND * W + c_2] = min(max(np.rint(second * per), -top), top) * lsb
            fx, ftx, fy = force[t], force[samples + t], force[2 * samples + t]
            fty, fz = force[3 * samples + t], force[4 * samples + t]
            for s in range(substeps):
                at = np.float64((first_sample + t) * substeps + s)
                for i in range(W):
                    advance(x, i, h, at, fx, ftx, fy, fty, fz)
            if t % TILE == TILE - 1:
                for c in range(width):
                    for j in range(TILE):
                        out[c * samples + t - (TILE - 1) + j] = tile[j * width + c]
        for t in range(samples - samples % TILE, samples):
            for c in range(width):
                out[c * samples + t] = tile[(t % TILE) * width + c]
        # Turns are exact to rounding; what rounding leaves of their size is taken off once a call.
        for i in range(W):
            size = np.sqrt(x[COS * W + i] * x[COS * W + i] + x[SIN * W + i] * x[SIN * W + i])
            x[COS * W + i] /= size
            x[SIN * W + i] /= size

    return compiled(step)
