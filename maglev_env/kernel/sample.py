"""Operations once per control sample for all lanes of an axis: read, control, and write the channels."""

from collections.abc import Callable

import numpy as np

from maglev_env.channels import step_channels
from maglev_env.kernel.layout import AXIS, INJECTED, LOADED, PUSHED, WANTED, WAVE, of_substep
from maglev_env.kernel.structure import Structure
from maglev_env.loop import amplifier, sensor
from maglev_env.loop.controller import (
    ACTING,
    DELAY_STEPS,
    ERROR,
    ERROR_STATE,
    HEAD,
    INPUT_STATE,
    U_OLD,
    U,
    command,
    filter_ahead,
    filter_output,
    inputs_ahead,
    limited_output,
    pid,
)
from maglev_env.loop.free import places as free
from maglev_env.loop.further import command_path, probe_play
from maglev_env.loop.mechanics import Y
from maglev_env.loop.self_sensing_pieces import note_error
from maglev_env.loop.sensor import DRAWN, NOISE, PEAK_SQ, SEEN, Z1, cross_seen, tone
from maglev_lanes.layout import LANES as W
from maglev_lanes.noise import drawn
from maglev_lanes.pieces import piece

# Positions of a sample's channels in a tile; the current is the last one, after the position if there is one.
COMMAND, POSITION = map(step_channels(sensed=True).index, ("command", "position"))


@piece
def draw(x, b, seeds, first, lanes, count):
    """Draw the noise of this reading of the axis at b.

    The number of lanes is an argument and not a constant, because the compiler would unroll such a short loop of
    constant length and then not vectorise it. Its indices are unsigned, because of any other number the compiler would
    ask whether it counts from the end, and then gather the lanes one by one.
    """
    to, own = np.uint64(b + DRAWN), np.uint64(first)
    for i in range(np.uint64(lanes)):
        x[to + i] = drawn(seeds[own + i], count)


def read_pieces(s: Structure, lanes: int = W) -> tuple[Callable, Callable, Callable]:
    """Functions that read, control and record the axis at b; they write into its sample at o of the tile.

    Args:
        s: the structure.
        lanes: all of a block, or 1 (see `single`).

    Returns:
        read(x, b, tile, o, off); off: 1 if the reading's error is accumulated, else 0.
        control(x, b, tile, o, reference, injection, f): also reads, and writes the command; f: offset of the axis'
        linear controller.
        late(x, b, tile, o): is called after the delay and records the current if it depends on the delay.
    """
    own, current_at = Z1 if s.sensed else sensor.seen(s.sensor_poles), (POSITION + (s.sensed is not None)) * W
    row, toned, planar, sensing = SEEN if s.coupled else own, s.flexible and not s.sensed, s.axes == 2, bool(s.sensed)
    coil, played = amplifier.coil(s.actuator_poles, s.delayed, s.flexible, s.shaped), s.further and not s.sensed
    behind = probe_play.played_shaped if s.shaped else probe_play.played
    freely = s.free and not s.sensed
    order, of_error = s.controller_order, s.of_error
    depends = s.actuator_poles == 0 or s.flexible  # whether the recorded current depends on the command after the delay

    wanted, injected = own_or_shared(s, WANTED), own_or_shared(s, INJECTED)

    @piece
    def note_reading(x, k, tile, o, off):
        sensed = x[k + row] + tone(x, k) if toned else x[k + row]
        if played:
            sensed = behind(x, k, sensed)
        if freely:
            sensed = free.read(x, k, sensed, off)
        now = sensor.shown(x, k, sensed + x[k + NOISE] * x[k + DRAWN])
        tile[o] = now
        if not planar:
            x[k + PEAK_SQ] = max(x[k + PEAK_SQ], now * now)
        if sensing:
            y = x[k + Y]
            note_error(x, k, off * (now - y))
            tile[o + POSITION * W] = y
        return now

    @piece
    def note_current(x, k, tile, o):
        current = coil(x, k)
        x[k + amplifier.CURRENT_SQ] += current * current
        tile[o + current_at] = current

    # All of this is in one loop: the compiler would unroll smaller ones and then not vectorise them.
    @piece
    def read(x, b, tile, o, off):
        for i in range(lanes):
            k = b + i
            note_reading(x, k, tile, o + i, off)
            tile[o + i + COMMAND * W] = x[k + U]
            if not depends:
                note_current(x, k, tile, o + i)

    @piece
    def control(x, b, tile, o, reference, injection, f):
        for i in range(lanes):
            k = b + i
            shown, asked = note_reading(x, k, tile, o + i, 1.0), wanted(x, k, reference)
            if order == 0:
                u = pid(x, k, asked - shown)
            elif of_error:
                x[k + ERROR] = asked - shown
                u = filter_output(x, k, f + i)
            else:
                u = limited_output(x, f + i, asked, shown, coil(x, k))
            tile[o + i + COMMAND * W] = command(x, k, u + injected(x, k, injection))
            if not depends:
                note_current(x, k, tile, o + i)
        if order > 0:  # a loop of no rounds would have its pieces compiled
            for j in range(order):
                for i in range(lanes):
                    if of_error:
                        filter_ahead(x, b + i, f + (1 + ERROR_STATE * j) * W + i)
                    else:
                        inputs_ahead(x, f + i, f + (HEAD + INPUT_STATE * j) * W + i, wanted(x, b + i, reference))

    @piece
    def late(x, b, tile, o):
        if depends:
            for i in range(lanes):
                note_current(x, b + i, tile, o + i)

    return read, control, late


def own_or_shared(s: Structure, of: int) -> Callable:
    """A piece (x, k, shared): the number that drives a lane, from its row `of`, or the one that all lanes share."""
    return piece(lambda x, k, shared: x[k + of]) if s.own_waves else piece(lambda x, k, shared: shared)


def waves_piece(s: Structure) -> Callable:
    """load(x, force, injection, reference, samples, t, same): copies what drives every lane at sample t into its rows.

    same: whether all lanes have the same wave. Numbers that are stored one by one delay the vectors that are read next.
    """
    axes = s.axes

    @piece
    def load(x, force, injection, reference, samples, t, same):
        for a in range(axes):
            if same:
                at = (np.int64(x[WAVE]) * axes + a) * samples + t
                pushed, injected, wanted = force[at], injection[at], reference[at]
                for i in range(W):
                    k = a * AXIS + i
                    x[k + PUSHED], x[k + INJECTED], x[k + WANTED] = pushed + x[k + LOADED], injected, wanted
                continue
            for i in range(W):
                at, k = (np.int64(x[i + WAVE]) * axes + a) * samples + t, a * AXIS + i
                x[k + PUSHED], x[k + INJECTED], x[k + WANTED] = force[at] + x[k + LOADED], injection[at], reference[at]

    return load


@piece
def same_wave(x):
    """Whether all lanes have the same wave."""
    others = 0
    for i in range(W):
        others += x[i + WAVE] != x[WAVE]
    return others == 0


def mix_piece(s: Structure, lanes: int = W) -> Callable:
    """mix(x): adds the share of the other axis' motion to each axis' sensed displacement."""
    own = Z1 if s.sensed else sensor.seen(s.sensor_poles)

    @piece
    def mix(x):
        for k in range(lanes):
            z_x, z_y = x[k + own], x[k + AXIS + own]
            x[k + SEEN], x[k + AXIS + SEEN] = cross_seen(x, k, z_x, z_y), cross_seen(x, k + AXIS, z_y, z_x)

    return mix


def _store_piece(s: Structure, lanes: int) -> Callable:
    """store(x, b, history, kept): writes the commands of the axis at b, as they are passed on, into the history."""
    further, freely = s.further, s.free
    source = command_path.PASSED if further else U

    @piece
    def store(x, b, history, kept):
        if further:  # a loop of its own, because the compiler cannot know that the history is not part of x
            for i in range(lanes):
                x[b + i + source] = command_path.passed_on(x, b + i)
        for i in range(lanes):
            u = x[b + i + source]
            history[kept + i] = free.commanded(x, b + i, u) if freely else u

    return store


def delay_piece(s: Structure, lanes: int = W) -> Callable:
    """delay(x, b, history, h, mask, now): stores the command in the history of the axis at h, and reads the command
    that acts and the one before it."""
    store = _store_piece(s, lanes)

    @piece
    def delay(x, b, history, h, mask, now):
        store(x, b, history, h + (now & mask) * W)
        if mask == 1:  # no lane is late by a whole sample: two whole rows are copied, not a number for each lane
            last, before = h + (now & mask) * W, h + ((now - 1) & mask) * W
            for i in range(lanes):
                x[b + i + ACTING], x[b + i + U_OLD] = history[last + i], history[before + i]
            return
        for i in range(lanes):
            behind = now - np.int64(x[b + i + DELAY_STEPS])
            x[b + i + ACTING] = history[h + (behind & mask) * W + i]
            x[b + i + U_OLD] = history[h + ((behind - 1) & mask) * W + i]

    return delay


def peak_piece(lanes: int = W) -> Callable:
    """peak(x, tile, o, stride): updates the largest radial displacement read; the second axis' sample is `stride`
    behind the first's."""

    @piece
    def peak(x, tile, o, stride):
        for k in range(lanes):
            x_shown, y_shown = tile[o + k], tile[o + stride + k]
            x[k + PEAK_SQ] = max(x[k + PEAK_SQ], x_shown * x_shown + y_shown * y_shown)

    return peak


def substep_piece(s: Structure) -> Callable:
    """load(x, kept, substep): copies the rows that differ between substeps to where the step reads them."""
    axes, rows = s.axes, of_substep(s.flexible)
    count = len(rows)

    @piece
    def load(x, kept, substep):
        for a in range(axes):
            for j in range(count):
                to, at = a * AXIS + rows[j], kept + ((substep * axes + a) * count + j) * W
                for i in range(W):
                    x[to + i] = x[at + i]

    return load
