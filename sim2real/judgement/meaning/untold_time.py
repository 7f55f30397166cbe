"""What a time between two channels that nobody states has taken up: a lag that shows, and that names no effect.

Of a drive that was measured beside the displacement, the time between the two readings is a nuisance of about a sample
where the campaign states none (`open_reading`). A lag of the sensor that is no longer than that looks exactly so. It is
no evidence of an effect, but neither is it nothing: it is said, and which effects may be it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.recorded.open_record import OpenRecord
from sim2real.search.fit import Fit
from sim2real.words import quantity

CLEAR = 4.0  # standard errors from which a time is said
LEAST = 0.1  # samples that it must have
# What is late after the channel that drives the simulation, and as good as nothing else while it is short.
LATE: Mapping[str, frozenset[str]] = {
    "current": frozenset({"sensor_lag"}),
    "command": frozenset({"sensor_lag", "amplifier_lag", "delay"}),
}


@dataclass(frozen=True)
class Late:
    """By how much the displacement comes after the channel that drives the simulation.

    Attributes:
        channel: That channel's kind, "current" or "command".
        time: s; negative: it comes before.
        se: Its standard error, s.
        samples: The time in samples.
        read: The recorded channel where that one is computed from it, "voltage"; empty: it is recorded.
    """

    channel: str
    time: float
    se: float
    samples: float
    read: str = ""

    @property
    def effects(self) -> frozenset[str]:
        """Effects that it may be."""
        return LATE.get(self.channel, frozenset()) if self.time > 0 else frozenset()

    @property
    def briefly(self) -> str:
        """The end of a sentence on it."""
        when = "later" if self.time > 0 else "earlier"
        may = f", or {' or '.join(sorted(self.effects))}" if self.effects else ""
        return (
            f"the displacement comes {quantity(abs(self.time), self.se, 's')} {when} than the {self.channel} says, "
            f"which may be when each is read{may}"
        )

    def in_words(self) -> str:
        """A sentence on it."""
        return (
            f"{self.briefly} ({abs(self.samples):.2g} samples; standard error): it counts for none of them; state "
            f"delay_tolerance of the {self.read or self.channel}"
        )


def late_readings(fitted: Problem, fit: Fit) -> Late | None:
    """The largest time between two channels that a fit shows clearly, among those that nobody states; None without one.

    Args:
        fitted: The recordings.
        fit: A fit of them with its Jacobian.
    """
    if not np.isfinite(fit.residual).all():
        return None
    amounts, spread = fitted.nuisances.amounts(fit.residual), fitted.nuisances.spread
    by_fit: dict[str, float] = {}
    if fit.jacobian is not None:
        rows = [fitted.nuisances.amounts(row) for row in fit.jacobian]
        for name in amounts:
            own = np.array([row[name] for row in rows])
            by_fit[name] = float(own @ fit.covariance() @ own)
    found = []
    for record in (part.record for part in fitted.parts):
        if not isinstance(record, OpenRecord):
            continue
        for e in record.errors:
            if e.name.startswith("time between") and e.name in amounts:
                # A nuisance is what changes when an error is put right: readings of the drive that are early by this.
                se = e.delay * float(np.sqrt(spread[e.name] ** 2 + by_fit.get(e.name, 0.0)))
                time = e.delay * amounts[e.name]
                samples = time * record.windows.sample_rate
                if abs(time) > CLEAR * se and abs(samples) > LEAST:
                    found.append(Late(e.channel, time, se, samples, e.read))
    return max(found, key=lambda late: abs(late.samples), default=None)
