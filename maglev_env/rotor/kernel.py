"""The rotor kernel: one compiled loop that steps LANES free rotors under digital control, in five degrees of freedom.

As the axis kernel: flat arrays with LANES consecutive values per variable, scalar pieces, constant offsets, no
branches, so that loops over lanes become full-width vector instructions.
"""

from collections.abc import Callable
from dataclasses import fields
from functools import cache

import numpy as np

from maglev_env.loop.controller import pid_step
from maglev_env.rotor.pieces import advance, follow_turn
from maglev_env.rotor.rows import (
    CHANNELS, COMMAND, COS, COUNT_MAX, COUNTS, CURRENT, D, DECAY_D, DECAY_I, INTO, KD, KI, KP, NOISE, OUT,
    ONCE, PER_COUNT, PER_U, PROBE, Q, SENSED, SIN, U_COUNT, U_MAX, XI,
)  # fmt: skip
from maglev_env.rotor.sensing import begin, follow_piece, read_coils
from maglev_lanes.compiled import compiled
from maglev_lanes.converter import quantised
from maglev_lanes.layout import LANES
from maglev_lanes.noise import drawn
from selfsense.kernel_pieces import SensorStructure

W = LANES
TILE = 8  # number of samples that are collected before they are written lane by lane


@cache
def kernel(substeps: int = 1, rejecting: bool = False, sensed: SensorStructure | None = None) -> Callable[..., None]:
    """The compiled stepper with a number of integration steps per control sample, with force rejection or without, and
    on the probes or on self-sensors.

    Called as step(block, seeds, first_sample, h, timing, force, injection, tile, out), all arrays flat. It advances the
    block over the samples of the waveforms.

    Args of the stepper:
        h: integration step, s.
        timing: (4,), of the self-sensors, as `maglev_env.kernel.sensing_lanes.timing_of` has it.
        force: (5, n), generalised forces, N and N m, held between samples.
        injection: (4, n), added to the commands, A, held between samples.
        tile: scratch, (TILE channels LANES); channels: CHANNELS, on self-sensors also SENSED.
        out: filled, (channels, LANES, n).
    """
    return _make(substeps, rejecting, sensed)


def _make(substeps, rejecting, sensed):
    sensing = sensed is not None
    sources, channels = 0, len(CHANNELS) + (len(SENSED) if sensing else 0)  # sources: see `compiled`
    width, own, read = channels * W, len(CHANNELS) * W, (len(CHANNELS) if sensing else 0)
    follow = follow_piece(sensed or SensorStructure(*[False] * len(fields(SensorStructure))))

    def step(x, seeds, first_sample, h, timing, force, injection, tile, out):
        if sources == 0:
            return
        samples = injection.size // 4
        left = np.zeros(4 * W)
        for t in range(samples):
            o = (t % TILE) * width
            count = np.uint64(np.int64(first_sample + t + 1))
            for q in range(4):
                for i in range(W):
                    sensed = x[i + PROBE + q * W] + x[i + NOISE] * drawn(seeds[q * W + i], count)
                    top = x[i + COUNT_MAX]
                    counts = quantised(sensed * x[i + COUNTS], -top, top, 1.0)
                    tile[o + q * W + i] = counts * x[i + PER_COUNT]
                    tile[o + (4 + q) * W + i] = x[i + CURRENT + q * W]
            for i in range(W):
                tile[o + 8 * W + i] = x[i + Q + 4 * W]
            if sensing:
                read_coils(x, tile, o + own)
            for d in range(2):
                for i in range(W):
                    a, b = tile[o + (read + d) * W + i], tile[o + (read + 2 + d) * W + i]
                    e = -(x[i + INTO] * a + x[i + INTO + W] * b)
                    e_2 = -(x[i + INTO + 2 * W] * a + x[i + INTO + 3 * W] * b)
                    c, c_2 = d * W + i, (2 + d) * W + i
                    if rejecting:
                        e, e_2 = e - x[i + ONCE + d * W], e_2 - x[i + ONCE + (2 + d) * W]
                        left[d * W + i], left[(2 + d) * W + i] = e, e_2
                    u, x[c + D], x[c + XI] = pid_step(
                        e, x[c + D], x[c + XI], x[c + KP], x[c + KD], x[c + KI], x[c + DECAY_D], x[c + DECAY_I]
                    )
                    u_2, x[c_2 + D], x[c_2 + XI] = pid_step(
                        e_2, x[c_2 + D], x[c_2 + XI],
                        x[c_2 + KP], x[c_2 + KD], x[c_2 + KI], x[c_2 + DECAY_D], x[c_2 + DECAY_I],
                    )  # fmt: skip
                    first = x[i + OUT] * u + x[i + OUT + W] * u_2 + injection[d * samples + t]
                    second = x[i + OUT + 2 * W] * u + x[i + OUT + 3 * W] * u_2 + injection[(2 + d) * samples + t]
                    top, per, lsb = x[i + U_MAX], x[i + PER_U], x[i + U_COUNT]
                    x[c + COMMAND] = quantised(first * per, -top, top, 1.0) * lsb
                    x[c_2 + COMMAND] = quantised(second * per, -top, top, 1.0) * lsb
            if rejecting:
                for i in range(W):
                    follow_turn(x, i, left)
            fx, ftx, fy = force[t], force[samples + t], force[2 * samples + t]
            fty, fz = force[3 * samples + t], force[4 * samples + t]
            for s in range(substeps):
                at = np.float64((first_sample + t) * substeps + s)
                if sensing:
                    begin(x)
                for i in range(W):
                    advance(x, i, h, at, fx, ftx, fy, fty, fz)
                if sensing:
                    follow(x, seeds, np.int64(first_sample + t) * substeps + s, timing)
            if t % TILE == TILE - 1:
                for c in range(width):
                    for j in range(TILE):
                        out[c * samples + t - (TILE - 1) + j] = tile[j * width + c]
        for t in range(samples - samples % TILE, samples):
            for c in range(width):
                out[c * samples + t] = tile[(t % TILE) * width + c]
        # Turns are exact to rounding; what rounding leaves of their size is taken off once a call.
        for i in range(W):
            size = np.sqrt(x[i + COS] * x[i + COS] + x[i + SIN] * x[i + SIN])
            x[i + COS] /= size
            x[i + SIN] /= size

    return compiled(step)
