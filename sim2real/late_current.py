"""A current whose readings come late, by a time that nobody states, beside a command that is known.

Where the command drives the simulation, the recorded current is compared too. Late readings look like a delay of the
command, which the displacement contradicts, and the fit settles between both: with another damping. So the delay is
told by the displacement alone, too. Where the current says another one, it is not compared.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim2real.axes_apart import fit_of_rows
from sim2real.coefficients import misfit
from sim2real.compared.problem import Problem
from sim2real.pooled_fit import fitted
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.search.fit import Fit

CLEAR = 4.0  # standard errors from which the two delays differ
POOR = 1.5  # misfit from which the displacement is fitted anew
LEAST = 0.1  # samples that they differ by at least


def lateness(problem: Problem, fit: Fit) -> float | None:
    """By how much more the current than the displacement says the command is late, s; None where no current is compared
    whose time is not stated, or where both agree."""
    at = next((i for i, c in enumerate(fit.hypothesis.coordinates) if c.effect == "delay"), None)
    beside = [part.record for part in problem.parts if _beside_command(part.record)]
    if at is None or not beside:
        return None
    delay = fit.hypothesis.coordinates[at]
    poor = misfit(fit) > POOR
    if poor:
        # The noise is what a good simulation leaves, and this is none.
        _, moving, _ = fitted(without_current([part.record for part in problem.parts]))
    else:
        moving = fit_of_rows(problem, fit, problem.output == problem.outputs.index("plant"))
    # The logarithmic or linear scale of a coordinate does not matter for a step this small.
    own, se = delay.value(float(moving.u[at])), float(np.sqrt(moving.covariance()[at, at])) * (delay.scale or 1.0)
    later = delay.value(float(fit.u[at])) - own
    sample = max(1 / record.windows.sample_rate for record in beside)
    clear = abs(later) > CLEAR * se or (poor and misfit(moving) < (1 + misfit(fit)) / 2)
    return later if clear and abs(later) > LEAST * sample else None


def without_current(records: Sequence[Record | OpenRecord]) -> list[Record | OpenRecord]:
    """Records in which no current is compared whose time is not stated."""
    return [replace(r, series={"displacement": r.series["displacement"]}) if _beside_command(r) else r for r in records]


def in_words(later: float) -> str:
    """A sentence on a `lateness` of either sign."""
    then, current, displacement = ("later", "late", "early") if later > 0 else ("earlier", "early", "late")
    return (
        f"the current is not compared: it says that the command comes {abs(later):.2g} s {then} than the "
        f"displacement does. Its readings are {current}, or the displacement's are {displacement}; state delay and "
        "delay_tolerance of the one that is"
    )


def _beside_command(record: Record | OpenRecord) -> bool:
    """Whether a current is compared beside the command that drives, and nothing is stated of its time."""
    if not isinstance(record, OpenRecord) or record.source != "command" or "current" not in record.series:
        return False
    return not any(e.channel == "current" and e.delay for e in record.errors)
