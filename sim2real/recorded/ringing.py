"""How the plant rings at the ends of an open record: what a transient adds that is not smooth over a window of lines.

The opened displacement is y - P u with the plant P of the nominal loop, and its transform carries what the plant's
own states hold at the beginning less what they hold at the end: a sum of z / (z - p) over the plant's poles p. Over a
window of lines most of it is a quadratic, which is projected out. Where a pole lies nearer to the lines than a window
is wide, as that of a rotor on springs with little damping, its lines ring far above the noise around them.
"""

from math import pi

import numpy as np

from estimation.lines.line_windows import KEPT, WIDTH
from maglev_env.experiment import axis_experiment
from maglev_env.linear.axis import linear_axis
from sim2real.recorded.open_loop import Loop
from sim2real.recorded.open_record import OpenRecord


def ringing(record: OpenRecord, loop: Loop, outputs: tuple[str, ...], noise: np.ndarray) -> dict[str, np.ndarray]:
    """Nuisances of one standard deviation, as columns (outputs, axes, n) by name.

    Args:
        record: the record.
        loop: its nominal loop.
        outputs: that are compared.
        noise: standard deviation (outputs, axes, n) of the coordinates' noise.
    """
    w, found, plant = record.windows, {}, outputs.index("plant")
    width = 2 * pi * WIDTH * w.sample_rate / w.samples
    z = np.exp(2j * pi * w.frequency / w.sample_rate)
    for axis in range(record.axes):
        poles = np.linalg.eigvals(linear_axis(axis_experiment(record.experiment, axis)).rates)
        for pole in poles[(abs(poles.real) < width) & (poles.imag >= 0) & (abs(poles) > 0)]:
            size = _amplitude(record, loop, axis, noise[plant, axis], abs(pole))
            one, other = (z / (z - np.exp(p / w.sample_rate)) for p in (pole, np.conj(pole)))
            for part, lines in (("cosine", one + other), ("sine", 1j * (one - other))):
                if np.any(lines):
                    column = np.zeros((len(outputs), record.axes, noise.shape[-1]), complex)
                    column[plant, axis] = w.project(size * lines / w.samples).ravel()
                    name = f"{part} of ringing at {abs(pole) / (2 * pi):.4g} Hz along axis {axis} of {record.name}"
                    found[name] = column
    return found


def _amplitude(record: OpenRecord, loop: Loop, axis: int, noise: np.ndarray, pole: float) -> float:
    """Standard deviation, m, of what a mode holds at one end of a record less what it holds at the other.

    Sensor noise moves the rotor through the closed loop, faster than the mode itself where the loop is stiffer; what
    else disturbs the rotor does so near the mode.

    Args:
        record: the record.
        loop: its nominal loop.
        axis: along which it moves.
        noise: standard deviation (n,) of the opened displacement's coordinates, m.
        pole: its size, 1/s.
    """
    own = loop.blocks.controller[axis] * loop.blocks.plant[axis]
    moved, left = (abs(v.reshape(loop.shape)) ** 2 for v in (own / (1 + own), 1 / (1 + own)))
    faster = 2 * pi * record.windows.frequency / pole
    near = abs(faster[:, WIDTH // 2] - 1) <= np.min(abs(faster[:, WIDTH // 2] - 1))
    power = moved * np.maximum(faster, 1.0) ** 2 + left * near[:, None]
    return float(np.sqrt(np.sum(power * noise.reshape(-1, KEPT)[:, :1] ** 2)))
