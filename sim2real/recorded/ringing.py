"""How the plant rings at the ends of an open record: what a transient adds that is not smooth over a window of lines.

The opened displacement is y - P u with the plant P of the nominal loop, and its transform carries what the plant's
own states hold at the beginning less what they hold at the end: a sum of z / (z - p) over the plant's poles p. Over a
window of lines most of it is a quadratic, which is projected out. Where a pole lies nearer to the lines than a window
is wide, as that of a rotor on springs with little damping, its lines ring far above the noise around them.
"""

from dataclasses import replace
from math import pi

import numpy as np

from estimation.lines.line_windows import KEPT, WIDTH
from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.linear.axis import linear_axis
from maglev_env.loop.effect import EFFECTS
from sim2real.recorded.nominal import nominal_blocks
from sim2real.recorded.open_loop import Loop
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import Opened

NEAR = 2.5  # windows from a pole, within which its ringing differs from a quadratic in the line number
SMALL = 1e-3  # singular values below this share of what a pole does where it does most are taken as zero
SAME = 1e-3  # relative distance within which two poles are one
NEAREST = 1e-9  # distance of a pole without damping from a line, as seen from z = 0


def ringing(
    record: OpenRecord, loop: Loop, outputs: tuple[str, ...], noise: np.ndarray, near: Experiment
) -> dict[str, np.ndarray]:
    """Nuisances of one standard deviation, as columns (outputs, axes, n) by name.

    Args:
        record: the record.
        loop: its nominal loop.
        outputs: that are compared.
        noise: standard deviation (outputs, axes, n) of the coordinates' noise.
        near: the record's experiment on the rig of the simulation that is compared.
    """
    w, found, plant = record.windows, {}, outputs.index("plant")
    for axis in range(record.axes):
        for pole in _poles(record, near, axis):
            size = _amplitude(record, loop, axis, noise[plant, axis], abs(pole))
            one, other = _rung(record, pole)
            for part, lines in (("cosine", one + other), ("sine", 1j * (one - other))):
                if np.any(lines):
                    column = np.zeros((len(outputs), record.axes, noise.shape[-1]), complex)
                    column[plant, axis] = w.project(size * lines / w.samples).ravel()
                    name = f"{part} of ringing at {abs(pole) / (2 * pi):.4g} Hz along axis {axis} of {record.name}"
                    found[name] = column
    return found


def ringing_directions(record: OpenRecord, near: Experiment, driven: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What ringing of any size adds to windows near the poles, beside all that the drives may explain there.

    Args:
        record: the record.
        near: as for `ringing`.
        driven: by `driven_directions`.

    Returns:
        directions: (windows, KEPT, n), orthonormal or zero, the same along every axis.
        rank: (windows,), how many of them are not zero.
    """
    w, columns = record.windows, []
    spacing = w.sample_rate / w.samples
    for pole in (pole for axis in range(record.axes) for pole in _poles(record, near, axis)):
        close = abs(w.centre - abs(pole) / (2 * pi)) < NEAR * WIDTH * spacing
        both = [w.project(lines) * close[:, None] for lines in _rung(record, pole)]
        size = max(np.linalg.norm(lines, axis=-1).max() for lines in both)
        columns += [lines / size for lines in both] if size else []
    if not columns:
        return np.zeros((w.count, KEPT, 0), complex), np.zeros(w.count, int)
    rung = np.stack(columns, axis=-1)  # (windows, KEPT, n)
    rung = rung - driven @ (np.conj(np.swapaxes(driven, 1, 2)) @ rung)
    u, s, _ = np.linalg.svd(rung, full_matrices=False)
    kept = s > SMALL
    return np.where(kept[:, None, :], u, 0.0), kept.sum(axis=1)


def driven_directions(record: OpenRecord) -> tuple[np.ndarray, np.ndarray]:
    """What the drives may explain by a smooth response: orthonormal or zero directions (windows, KEPT, n), and how many
    are not zero in each window."""
    w = record.windows
    unit = np.broadcast_to(np.eye(KEPT)[:, None], (KEPT, w.count, KEPT))
    inside, rank = w.along(unit, record.drives)  # (KEPT, windows, n): conjugates of the directions
    return np.moveaxis(np.conj(inside), 0, 1), rank


def without(coordinates: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Coordinates (..., windows, KEPT) without their parts along orthonormal directions (windows, KEPT, n)."""
    along = np.einsum("...wk,wkd->...wd", coordinates, np.conj(directions))
    return coordinates - np.einsum("...wd,wkd->...wk", along, directions)


def _poles(record: OpenRecord, near: Experiment, axis: int) -> list[complex]:
    """Poles (1/s) that lie nearer to the lines than a window is wide, of pairs the upper ones: of the nominal plant, at
    which the record is opened, and of the simulated one, with which the rotor swings."""
    w, found = record.windows, []
    width = 2 * pi * WIDTH * w.sample_rate / w.samples
    linear = {name: values for name, values in near.effects.items() if EFFECTS[name].linear}
    for e in (record.experiment, replace(near, effects=linear)):
        poles = np.linalg.eigvals(linear_axis(axis_experiment(e, axis)).rates)
        poles = poles[(abs(poles.real) < width) & (poles.imag >= 0) & (abs(poles) > 0)]
        found += [p for p in poles if all(abs(p - other) > SAME * abs(p) for other in found)]
    return found


def _rung(record: OpenRecord, pole: complex) -> tuple[np.ndarray, np.ndarray]:
    """Lines (windows, WIDTH) of a pole and of its conjugate."""
    w = record.windows
    z = np.exp(2j * pi * w.frequency / w.sample_rate)
    off = [z - np.exp(p / w.sample_rate) for p in (pole, np.conj(pole))]
    one, other = (z / np.where(abs(d) < NEAREST, NEAREST, d) for d in off)
    return one, other


def _amplitude(record: OpenRecord, loop: Loop, axis: int, noise: np.ndarray, pole: float) -> float:
    """Standard deviation, m, of what a mode holds at one end of a record less what it holds at the other.

    Sensor noise moves the rotor through the closed loop, faster than the mode itself where the loop is stiffer; what
    else disturbs the rotor does so near the mode. A tone begins and ends with the record wherever it lies.

    Args:
        record: the record.
        loop: its nominal loop.
        axis: along which it moves.
        noise: standard deviation (n,) of the opened displacement's coordinates, m.
        pole: its size, 1/s.
    """
    w = record.windows
    # Noise moves the rotor up to the loop's bandwidth, however few of the lines its drives make worth comparing.
    beyond = np.arange(w.centre[-1], w.sample_rate / 2, WIDTH * w.sample_rate / w.samples)[1:]
    compared = loop.blocks.controller[axis] * loop.blocks.plant[axis]
    further = Opened(*nominal_blocks(record.experiment, beyond, False), ("plant",))
    own = np.concatenate([compared, further.controller[axis] * further.plant[axis]])
    moved, left = abs(own / (1 + own)) ** 2, abs(1 / (1 + own)) ** 2
    frequency, lines = np.append(w.frequency, beyond), np.append(np.ones(compared.size), np.full(beyond.size, WIDTH))
    of_window = np.append(np.repeat(noise[::KEPT], WIDTH), np.full(beyond.size, noise[-1]))
    faster = 2 * pi * frequency / pole
    around = abs(2 * pi * np.append(w.centre, beyond) / pole - 1)
    near = np.append(np.repeat(around[: w.count], WIDTH), around[w.count :]) <= around.min()
    power = moved * np.maximum(faster, 1.0) ** 2 + left * near
    total = float(np.sum(lines * power * of_window**2))
    for tone in record.tones:
        at = int(np.argmin(abs(frequency - tone.frequency)))
        held = max(moved[at], left[at]) * max(faster[at], 1.0) ** 2
        total += float(held * abs(tone.amplitude["opened"][axis]) ** 2)
    return float(np.sqrt(total))
