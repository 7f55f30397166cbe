"""The lane kernel: one compiled loop that steps LANES simulations of the nominal loop together, in one axis or x-y.

A block is flat arrays with LANES consecutive values per variable: constant strides are what lets the compiler turn
the loops over lanes into full-width vector instructions. Blocks are always full, so a lane's bits do not depend on
how many others run beside it. Absent effects are compiled out.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache
from hashlib import sha256
from pathlib import Path

import numba as nb
import numpy as np

from maglev_env.channels import step_channels
from maglev_env.kernel import effect_rows, effects as kernel_effects, pieces as kernel_pieces, rows as kernel_rows
from selfsense import kernel_pieces as sensor_source
from selfsense import kernel_rows as sensor_rows
from maglev_lanes import noise as noise_source
from maglev_env.kernel.effect_rows import COMMAND_ROWS, command_row
from maglev_env.kernel.effects import effect_pieces, move_piece, reading_pieces
from maglev_env.kernel.pieces import axis_pieces, sensing_pieces
from maglev_env.kernel.rows import (
    ACTING,
    ALIVE,
    ARRIVED,
    CHAIN_ROWS,
    COUNT_MAX,
    CROSS_SENSOR,
    CURRENT_SQ,
    D,
    DECAY_D,
    DECAY_I,
    DELAY_STEPS,
    ERROR,
    KD,
    KI,
    KP,
    LANES,
    LIMIT_SQ,
    NOISE,
    PEAK_SQ,
    PER_COUNT,
    PER_MASS,
    PER_U_COUNT,
    PROBE_COUNTS,
    RAW,
    SENSED,
    STEPS,
    U,
    U_COUNT,
    U_COUNT_MAX,
    U_OLD,
    V,
    X1,
    X2,
    XI,
    Y,
    Z1,
    Z2,
    axis_rows,
    effect_row,
    filter_row,
)
from selfsense.kernel_pieces import SensorStructure, sensor_pieces
from selfsense.kernel_rows import GAP as COIL_GAP
from selfsense.kernel_rows import OFF_PEAK, OFF_SQ, OFF_SUM, SENSOR_ROWS
from maglev_lanes.noise import FAST, normal

W = LANES
# The compiler's disk cache looks at this file alone; naming what it was compiled from keeps it from serving stale code.
_PARTS = (kernel_pieces, kernel_rows, kernel_effects, effect_rows, noise_source, sensor_source, sensor_rows)
SOURCES = int(sha256(b"".join(Path(part.__file__).read_bytes() for part in _PARTS)).hexdigest()[:15], 16)
# Where the step writes; the current is the last channel, with a sensed position before it or without.
DISPLACEMENT, COMMAND, POSITION = map(step_channels(sensed=True).index, ("displacement", "command", "position"))
# Samples gathered before they are written out lane by lane, so that a lane's series is contiguous.
TILE = 8


@dataclass(frozen=True)
class Structure:
    """What is compiled in: magnets ("gap" or "magnet" for a pair by its flux path, "none"), support, poles per chain,
    delay, converters, noise, order of a linear controller (0: the PID), axes, whether anything couples them,
    self-sensors in the probes' place, fields that saturate, whether all the other effects are there at once, two poles
    in each chain and a delay among them (a lane without one carries neutral constants), and whether their friction
    sticks."""

    magnets: str
    supported: bool
    sensor_poles: int
    actuator_poles: int
    delayed: bool
    adc: bool
    dac: bool
    noise: bool
    controller_order: int = 0
    axes: int = 1
    coupled: bool = False
    sensed: SensorStructure | None = None
    saturating: bool = False
    flexible: bool = False
    sticking: bool = False

    @property
    def channels(self) -> tuple[str, ...]:
        """What the kernel can write, in this order."""
        return step_channels(sensed=bool(self.sensed))


@cache
def kernel(structure: Structure, outputs: int, substeps: int = 1, oversampled: bool = False) -> Callable[..., int]:
    """The compiled stepper for a structure: so many leading of its channels written, `substeps` per control sample.

    Called as step(block, seeds, history, first_step, timing, force, injection, reference, tile, out), all arrays flat,
    axis after axis: advances the block over the control samples of the waveforms and fills out (axes, outputs, LANES,
    samples), with `oversampled` a sample for every substep; tile is scratch of TILE samples. timing, of self-sensors:
    so many current samples in so many substeps, so many in so many PWM periods. Returns the control samples done: fewer
    when every lane has touched down.
    """
    return _make(outputs=outputs, substeps=substeps, oversampled=oversampled, **vars(structure))


def _make(
    magnets, supported, sensor_poles, actuator_poles, delayed, adc, dac, noise, controller_order, axes, coupled, sensed,
    saturating, flexible, sticking, outputs, substeps, oversampled,
):  # fmt: skip
    sixth, sources = 1.0 / 6.0, SOURCES
    controlled, planar = magnets != "none", axes == 2
    rows, effects = axis_rows(substeps, controller_order, flexible), effect_row(substeps, controller_order)
    size, filter_start = rows * W, filter_row(substeps) * W  # of one axis
    rate = substeps if oversampled else 1  # samples written per control sample
    width = axes * outputs * W
    sensing = sensed is not None
    seen = Z1 if sensing else (Y, Z1, Z2)[sensor_poles]
    current_at = POSITION + sensing
    own, own_2 = axes * rows, axes * rows + SENSOR_ROWS  # where the self-sensors' rows begin
    drifting = sensing and sensed.drifting
    kind = (magnets, supported, sensor_poles, actuator_poles, delayed, saturating, flexible, sticking, effects)
    currents, pull, drag, probe, push, sway, beside = axis_pieces(0, rows, *kind)
    currents_2, pull_2, drag_2, probe_2, push_2, sway_2, beside_2 = axis_pieces(rows, 0, *kind)
    sensor = sensed or SensorStructure(*[False] * len(fields(SensorStructure)))
    switch, advance, across, read, _ = sensor_pieces(own, sensor)
    switch_2, advance_2, across_2, read_2, _ = sensor_pieces(own_2, sensor)
    begin, gap, target, show = sensing_pieces(0, own, actuator_poles, delayed, flexible, effects)
    begin_2, gap_2, target_2, show_2 = sensing_pieces(rows, own_2, actuator_poles, delayed, flexible, effects)
    tone, coil = reading_pieces(effects)
    move = move_piece(
        effect_pieces(effects, controlled), (pull, drag, push, sway), size, planar, coupled, sensing, sticking
    )  # fmt: skip
    changing = (effects + effect_rows.COMMAND) * W  # where rows of the commands that a substep has for itself are put
    kept, per_substep = (effects + command_row(0)) * W, COMMAND_ROWS * W

    @nb.njit(fastmath=FAST, error_model="numpy", nogil=True, cache=True)
    def step(x, seeds, history, first_step, timing, force, injection, reference, tile, out):
        if sources == 0:
            return 0
        slots = history.size // axes
        mask = np.int64(slots // W - 1)
        samples = force.size // axes
        written = samples * rate
        for t in range(samples):
            now = (np.int64(first_step + t) & mask) * W
            for s in range(substeps):
                n = t * rate + (s if oversampled else 0)
                # Readings between control samples draw from far away, so that those at them do not depend on the rate.
                count = np.uint64(np.int64(first_step + t + 1) + (np.int64(s) << 40))
                if coupled:
                    for i in range(W):
                        z, z_2 = x[seen * W + i], x[size + seen * W + i]
                        x[SENSED * W + i] = z + x[CROSS_SENSOR * W + i] * z_2
                        x[size + SENSED * W + i] = z_2 + x[size + CROSS_SENSOR * W + i] * z
                for a in range(axes if s == 0 or oversampled else 0):
                    b, o = a * size, ((n % TILE) * axes + a) * outputs * W
                    inject, ref = injection[a * samples + t], reference[a * samples + t]
                    for i in range(W):
                        sensed = x[b + (SENSED if coupled else seen) * W + i]
                        if flexible and not sensing:
                            sensed = sensed + tone(x, b, i)
                        if noise:
                            sensed = sensed + x[b + NOISE * W + i] * normal(seeds[a * W + i], count)
                        counts = sensed * x[b + PROBE_COUNTS * W + i]
                        if adc:
                            counts = np.rint(counts)
                        top = x[b + COUNT_MAX * W + i]
                        shown = min(max(counts, -top), top) * x[b + PER_COUNT * W + i]
                        tile[o + DISPLACEMENT * W + i] = shown
                        if sensing:
                            c, y = (own + a * SENSOR_ROWS) * W + i, x[b + Y * W + i]
                            off = shown - y if s == 0 else 0.0
                            x[c + OFF_SUM * W] += off
                            x[c + OFF_SQ * W] += off * off
                            x[c + OFF_PEAK * W] = max(x[c + OFF_PEAK * W], abs(off))
                            if outputs > POSITION:
                                tile[o + POSITION * W + i] = y
                        if not planar:
                            x[b + PEAK_SQ * W + i] = max(x[b + PEAK_SQ * W + i], shown * shown)
                        if controlled and s == 0:
                            e = ref - shown
                            if controller_order == 0:
                                lag, xi = e - x[b + D * W + i], x[b + XI * W + i]
                                u = x[b + KP * W + i] * e + x[b + KD * W + i] * lag + x[b + KI * W + i] * xi
                                x[b + D * W + i] = e - lag * x[b + DECAY_D * W + i]
                                x[b + XI * W + i] = e + (xi - e) * x[b + DECAY_I * W + i]
                                u = (u + inject) * x[b + PER_U_COUNT * W + i]
                                if dac:
                                    u = np.rint(u)
                                top = x[b + U_COUNT_MAX * W + i]
                                x[b + U * W + i] = min(max(u, -top), top) * x[b + U_COUNT * W + i]
                            else:
                                x[b + ERROR * W + i] = e
                        tile[o + COMMAND * W + i] = x[b + U * W + i]
                    if controlled and controller_order > 0 and s == 0:
                        # Transposed direct form: b0, then (b, a, state) for each power of 1 / z.
                        for i in range(W):
                            f = b + filter_start + i
                            u = x[f] * x[b + ERROR * W + i] + x[f + 3 * W]
                            x[b + RAW * W + i] = u
                            u = (u + inject) * x[b + PER_U_COUNT * W + i]
                            if dac:
                                u = np.rint(u)
                            top = x[b + U_COUNT_MAX * W + i]
                            x[b + U * W + i] = min(max(u, -top), top) * x[b + U_COUNT * W + i]
                            tile[o + COMMAND * W + i] = x[b + U * W + i]
                        for j in range(controller_order):
                            g = b + filter_start + (1 + 3 * j) * W
                            for i in range(W):
                                fed = x[g + i] * x[b + ERROR * W + i] - x[g + W + i] * x[b + RAW * W + i]
                                x[g + 2 * W + i] = fed + x[g + 5 * W + i]
                    if delayed and s == 0:
                        h = a * slots
                        for i in range(W):
                            history[h + now + i] = x[b + U * W + i]
                        for i in range(W):
                            behind = np.int64(first_step + t) - np.int64(x[b + DELAY_STEPS * W + i])
                            x[b + ACTING * W + i] = history[h + (behind & mask) * W + i]
                            x[b + U_OLD * W + i] = history[h + ((behind - 1) & mask) * W + i]
                    for i in range(W):
                        if flexible:
                            current = coil(x, b, i, s)
                        elif actuator_poles == 2:
                            current = x[b + X2 * W + i]
                        elif actuator_poles == 1:
                            current = x[b + X1 * W + i]
                        elif delayed:
                            new = x[b + (ARRIVED + s * CHAIN_ROWS) * W + i]
                            current = new * x[b + ACTING * W + i] + (1.0 - new) * x[b + U_OLD * W + i]
                        else:
                            current = x[b + U * W + i]
                        x[b + CURRENT_SQ * W + i] += current * current
                        if outputs > current_at:
                            tile[o + current_at * W + i] = current
                if planar and (s == 0 or oversampled):
                    for i in range(W):
                        o = (n % TILE) * width + DISPLACEMENT * W + i
                        reach = tile[o] * tile[o] + tile[o + outputs * W] * tile[o + outputs * W]
                        x[PEAK_SQ * W + i] = max(x[PEAK_SQ * W + i], reach)
                row = s * CHAIN_ROWS * W
                force_now = force[t]
                force_now_2 = force[samples + t] if planar else 0.0
                if sensing:
                    for i in range(W):
                        begin(x, i)
                        if planar:
                            begin_2(x, i)
                if flexible and substeps > 1:
                    for a in range(axes):
                        for j in range(per_substep):
                            x[a * size + changing + j] = x[a * size + kept + s * per_substep + j]
                if flexible:
                    move(x, force_now, force_now_2)
                else:
                    # Nystrom, 4th order: the middle stages share a position, so the magnets are evaluated thrice.
                    for i in range(W):
                        y, v = x[Y * W + i], x[V * W + i]
                        f = force_now * x[PER_MASS * W + i]
                        c0, c1, c2, n1, n2 = currents(x, row, i)
                        a1 = pull(x, i, y, c0) + f - drag(x, i, v)
                        if planar:
                            y_2, v_2 = x[size + Y * W + i], x[size + V * W + i]
                            f_2 = force_now_2 * x[size + PER_MASS * W + i]
                            c0_2, c1_2, c2_2, n1_2, n2_2 = currents_2(x, row, i)
                            a1_2 = pull_2(x, i, y_2, c0_2) + f_2 - drag_2(x, i, v_2)
                        if coupled:
                            a1 = a1 + push(x, i, y_2, c0_2) - sway(x, i, v_2)
                            a1_2 = a1_2 + push_2(x, i, y, c0) - sway_2(x, i, v)
                        ym = y + 0.5 * v + 0.125 * a1
                        held = pull(x, i, ym, c1) + f
                        a2 = held - drag(x, i, v + 0.5 * a1)
                        if planar:
                            ym_2 = y_2 + 0.5 * v_2 + 0.125 * a1_2
                            held_2 = pull_2(x, i, ym_2, c1_2) + f_2
                            a2_2 = held_2 - drag_2(x, i, v_2 + 0.5 * a1_2)
                        if coupled:
                            pushed, pushed_2 = push(x, i, ym_2, c1_2), push_2(x, i, ym, c1)
                            held, held_2 = held + pushed, held_2 + pushed_2
                            a2 = a2 + pushed - sway(x, i, v_2 + 0.5 * a1_2)
                            a2_2 = a2_2 + pushed_2 - sway_2(x, i, v + 0.5 * a1)
                        a3 = held - drag(x, i, v + 0.5 * a2)
                        if planar:
                            a3_2 = held_2 - drag_2(x, i, v_2 + 0.5 * a2_2)
                        if coupled:
                            a3 = a3 - sway(x, i, v_2 + 0.5 * a2_2)
                            a3_2 = a3_2 - sway_2(x, i, v + 0.5 * a2)
                        ye = y + v + 0.5 * a3
                        a4 = pull(x, i, ye, c2) + f - drag(x, i, v + a3)
                        if planar:
                            ye_2 = y_2 + v_2 + 0.5 * a3_2
                            a4_2 = pull_2(x, i, ye_2, c2_2) + f_2 - drag_2(x, i, v_2 + a3_2)
                        if coupled:
                            a4 = a4 + push(x, i, ye_2, c2_2) - sway(x, i, v_2 + a3_2)
                            a4_2 = a4_2 + push_2(x, i, ye, c2) - sway_2(x, i, v + a3)
                        y1, v1 = y + v + (a1 + a2 + a3) * sixth, v + (a1 + 2.0 * (a2 + a3) + a4) * sixth
                        reach = y1 * y1
                        if planar:
                            y1_2 = y_2 + v_2 + (a1_2 + a2_2 + a3_2) * sixth
                            v1_2 = v_2 + (a1_2 + 2.0 * (a2_2 + a3_2) + a4_2) * sixth
                            reach = reach + y1_2 * y1_2
                        # A lane that touches down stays where it was: nothing beyond the clearance is simulated.
                        alive = x[ALIVE * W + i] if reach < x[LIMIT_SQ * W + i] else 0.0
                        x[ALIVE * W + i] = alive
                        x[STEPS * W + i] += alive
                        # Both probes see the currents from which the step began.
                        z1, z2 = probe(x, row, i, y, v, y1, v1)
                        if planar:
                            z1_2, z2_2 = probe_2(x, row, i, y_2, v_2, y1_2, v1_2)
                        if coupled:
                            w1, w2 = beside(x, row, i)
                            w1_2, w2_2 = beside_2(x, row, i)
                            z1, z2, z1_2, z2_2 = z1 + w1, z2 + w2, z1_2 + w1_2, z2_2 + w2_2
                        if sensor_poles >= 1:
                            x[Z1 * W + i] = z1
                        if sensor_poles == 2:
                            x[Z2 * W + i] = z2
                        if actuator_poles >= 1:
                            x[X1 * W + i] = n1
                        if actuator_poles == 2:
                            x[X2 * W + i] = n2
                        x[Y * W + i] = y1 if alive > 0.0 else y
                        x[V * W + i] = v1 * alive
                        if planar:
                            if sensor_poles >= 1:
                                x[size + Z1 * W + i] = z1_2
                            if sensor_poles == 2:
                                x[size + Z2 * W + i] = z2_2
                            if actuator_poles >= 1:
                                x[size + X1 * W + i] = n1_2
                            if actuator_poles == 2:
                                x[size + X2 * W + i] = n2_2
                            x[size + Y * W + i] = y1_2 if alive > 0.0 else y_2
                            x[size + V * W + i] = v1_2 * alive
                if sensing:
                    # The rotor's step is made: follow it at the level of single switching edges.
                    tick = np.int64(first_step + t) * substeps + s
                    ticks, cycle, per_cycle = timing[1], timing[2], timing[3]
                    share, period = per_cycle / cycle, cycle / per_cycle
                    for m in range(tick * timing[0] // ticks, (tick + 1) * timing[0] // ticks):
                        at, count = m * per_cycle % cycle, np.uint64(m + 1)
                        start, per_tick = at / cycle, ticks / timing[0]
                        here = (m + 1) * per_tick - tick
                        ahead = (m - start * period + period) * per_tick - tick
                        if at == 0:
                            for i in range(W):
                                switch(x, i, target(x, i, ahead), x[(own + COIL_GAP) * W + i])
                                if planar:
                                    switch_2(x, i, target_2(x, i, ahead), x[(own_2 + COIL_GAP) * W + i])
                        if drifting and at + per_cycle > cycle:
                            later = ahead + period * per_tick
                            for i in range(W):
                                across(x, i, start, share, gap(x, i, here), target(x, i, later))
                                read(x, i, seeds[i], count)
                                if planar:
                                    across_2(x, i, start, share, gap_2(x, i, here), target_2(x, i, later))
                                    read_2(x, i, seeds[W + i], count)
                        else:
                            for i in range(W):
                                advance(x, i, start, share, gap(x, i, here))
                                read(x, i, seeds[i], count)
                                if planar:
                                    advance_2(x, i, start, share, gap_2(x, i, here))
                                    read_2(x, i, seeds[W + i], count)
                    for i in range(W):
                        show(x, i)
                        if planar:
                            show_2(x, i)
                if n % TILE == TILE - 1 and (oversampled or s == substeps - 1):
                    for c in range(width):
                        for j in range(TILE):
                            out[c * written + n - (TILE - 1) + j] = tile[j * width + c]
            if t % TILE == TILE - 1:
                living = 0.0
                for i in range(W):
                    living += x[ALIVE * W + i]
                if living == 0.0:
                    return t + 1
        for n in range(written - written % TILE, written):
            for c in range(width):
                out[c * written + n] = tile[(n % TILE) * width + c]
        return samples

    return step
