"""Noise that stands out of its surroundings as a tone would: at a resonance, or beside a notch of the closed loop."""

from dataclasses import replace

import numpy as np
from scipy import stats

from estimation.lines.line_windows import WIDTH
from estimation.lines.tones import FALSE_ALARM, NEIGHBOURS, Tone
from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import EFFECTS
from sim2real.compared.point import Point, experiment_at
from sim2real.compared.tones_left import resolution_of
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record

PEAK = 1.5  # times the mean power of the response over a window from which a line of it is part of a peak
NO_TANGENT = {name for name, card in EFFECTS.items() if not card.linear}


def noise_at_peak(record: Record | OpenRecord, point: Point, tone: Tone) -> bool:
    """Whether a tone may be noise that is louder at its frequency than the level from which it stands out.

    That level is told over a window of lines, or is the median of those between the harmonics. A rotor on springs
    answers the lines at its resonance far more than it does that window, and its closed loop leaves next to nothing of
    the noise there, so that about it the median is far below the noise.
    """
    e = experiment_at(record.experiment, linear(point))
    rise = max(_rise(record, e, axis, tone.frequency) for axis in range(record.axes))
    lines = record.windows.count * WIDTH if isinstance(record, OpenRecord) else record.series["displacement"].shape[1]
    chance = stats.chi2.logsf(tone.chi2 / rise, 2 * record.axes)
    return bool(rise > PEAK and chance + np.log(lines) > np.log(FALSE_ALARM))


def _rise(record: Record | OpenRecord, e: Experiment, axis: int, frequency: float) -> float:
    """Power of the noise at a frequency (Hz) over that of the lines from which its level is told, of one axis: of the
    reading's or of forces, in whichever it is more.

    What is left of a recording without a period was opened as the loop of the nominal rig. Where a rotor on springs
    resonates elsewhere than there, this makes a peak of the noise at the resonance that it does not have.

    Args:
        record: The record.
        e: Its experiment at the point.
        axis: On which of its axes.
        frequency: Of a tone.
    """
    if isinstance(record, OpenRecord):
        lines = frequency + np.arange(-(WIDTH // 2), WIDTH // 2 + 1) * resolution_of(record)
        at = np.array([frequency, *lines[lines > 0]])
        r, opened = (loop_response(axis_experiment(own, axis), at) for own in (e, record.experiment))
        powers = (abs(own / opened.sensitivity) ** 2 for own in (r.sensitivity, r.receptance))
        return max(float(power[0] / power[1:].mean()) for power in powers)
    spacing = resolution_of(record) * record.count / (record.count - 1)  # without the harmonics
    lines = abs(frequency + np.arange(-NEIGHBOURS, NEIGHBOURS + 1) * spacing)  # mirrored at zero, as the median is
    r = loop_response(axis_experiment(e, axis), np.array([frequency, *np.maximum(lines, spacing)]))
    powers = (abs(own) ** 2 for own in (r.sensitivity, r.receptance))
    return max(float(power[0] / np.median(power[1:])) for power in powers)


def linear(point: Point) -> Point:
    """A point without the effects that have no tangent."""
    return replace(point, effects={name: v for name, v in point.effects.items() if name not in NO_TANGENT})
