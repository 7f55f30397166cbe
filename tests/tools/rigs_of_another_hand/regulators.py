"""Controllers of benches as engineers program them, one number per tick; each can say its polynomials in z."""

from dataclasses import dataclass, field
from math import exp

import numpy as np


@dataclass
class Pid:
    """kp e + ki sum(e) dt + kd times the derivative of the error, filtered by td (s; 0: a plain difference)."""

    kp: float
    ki: float
    kd: float
    td: float
    dt: float
    total: float = 0.0
    low: float = 0.0
    last: float = 0.0

    def __call__(self, error: float) -> float:
        self.total += self.ki * error * self.dt
        if self.td:
            decay = exp(-self.dt / self.td)
            self.low = decay * self.low + (1 - decay) * error
            rate = (error - self.low) / self.td
        else:
            rate = (error - self.last) / self.dt
        self.last = error
        return self.kp * error + self.total + self.kd * rate

    def polynomials(self) -> tuple[list[float], list[float]]:
        """Numerator and denominator in z of output over error, highest power first, denominator starting with 1."""
        if self.td:
            decay = exp(-self.dt / self.td)
            lead, low = np.array([1.0, -1.0]) * self.kd / self.td * decay, np.array([1.0, -decay])
        else:
            lead, low = np.array([1.0, -1.0]) * self.kd / self.dt, np.array([1.0, 0.0])
        if not self.ki:
            return list(np.polyadd(self.kp * low, lead)), list(low)
        one = np.array([1.0, -1.0])
        integral = self.ki * self.dt * np.array([1.0, 0.0])
        top = np.polyadd(np.polyadd(self.kp * np.polymul(one, low), np.polymul(integral, low)), np.polymul(one, lead))
        return list(top), list(np.polymul(one, low))


@dataclass
class Cascade:
    """An outer controller asks for a current (A, added to `rest`), an inner PI for the voltage (V)."""

    outer: Pid
    kp: float
    ki: float
    rest: float
    feed: float = 0.0  # V/A of the wanted current, fed forward
    wanted: float = field(default=0.0, init=False)
    total: float = field(default=0.0, init=False)

    def voltage(self, error: float, current: float) -> float:
        self.wanted = self.rest + self.outer(error)
        miss = self.wanted - current
        self.total += self.ki * miss * self.outer.dt
        return self.kp * miss + self.total + self.feed * self.wanted
