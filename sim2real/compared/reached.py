"""How far the recordings go: the largest current that the controller asks for in them, and the largest motion."""

import numpy as np

from maglev_env.experiment import axis_experiment
from maglev_env.linear.loop import loop_response
from sim2real.compared.problem import Problem
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record

CREST = 2.5  # peak over root mean square of several lines together


def current_reached(problem: Problem) -> float:
    """Largest deviation, A, of the command from its mean in any recording; 1 A where there is no controller."""
    most = max((_command(part.record) for part in problem.parts), default=0.0)
    return most or 1.0


def motion_reached(problem: Problem) -> float:
    """Largest deviation, m, of the displacement from its mean in any recording."""
    return max(moved(part.record) for part in problem.parts)


def moved(record: Record | OpenRecord) -> float:
    """Largest deviation, m, of the displacement from its mean in a recording."""
    y = record.series["displacement"]
    return float(np.max(abs(y - y.mean(axis=1, keepdims=True))))


def _command(record: Record | OpenRecord) -> float:
    if not record.nominal.controlled:
        return 0.0
    if isinstance(record, OpenRecord):
        return float(np.max(abs(record.command - record.command.mean(axis=1, keepdims=True))))
    error = record.driving("reference") - record.mean("displacement")
    injected, most = record.driving("current"), 0.0
    for axis in range(record.axes):
        r = loop_response(axis_experiment(record.experiment, axis), record.frequency)
        most = max(most, CREST * float(np.sqrt(0.5 * np.sum(abs(r.controller * error[axis] + injected[axis]) ** 2))))
    return most
