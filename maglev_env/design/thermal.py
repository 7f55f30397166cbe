"""Warming of a pump's housing: one heat capacity behind one thermal resistance, and their identification.

D 3.5.3 gives two readings: 22 C at the start and 40 C after two hours at 14,000 rpm in air.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from selfsense.coil import is_number


@dataclass(frozen=True)
class ThermalMass:
    """capacity dT/dt = loss - (T - ambient) / resistance, with one temperature for the whole body.

    Attributes:
        capacity: C, J/K.
        resistance: R, to the ambient, K/W.

    Raises:
        ValueError: Unless both are positive numbers.
    """

    capacity: float
    resistance: float

    def __post_init__(self) -> None:
        for name in ("capacity", "resistance"):
            value = getattr(self, name)
            if not (is_number(value) and value > 0):
                raise ValueError(f"thermal: {name} = {value!r} must be a number above 0")

    @property
    def time_constant(self) -> float:
        """tau = R C, s."""
        return self.resistance * self.capacity

    def temperature(
        self, time: ArrayLike, loss: float, ambient: float, start: float | None = None
    ) -> NDArray[np.float64]:
        """Temperature (n,) at time (n,) s under a constant loss (W), in the scale of ambient and start.

        start: temperature at time 0 (None: that of the ambient).
        """
        final = ambient + loss * self.resistance
        begun = ambient if start is None else start
        return final + (begun - final) * np.exp(-np.asarray(time, dtype=float) / self.time_constant)


def final_rise(rise: float, duration: float, time_constant: ArrayLike) -> NDArray[np.float64]:
    """Final rise R P (K), given one rise (K) after a duration (s) from the ambient temperature.

    One reading gives one equation, R P (1 - exp(-duration / tau)) = rise, so the time constant (n,) s must be assumed.
    The reading shows that R P >= rise and that the initial slope P / C is at least rise / duration, but neither tau
    nor R P; and even from both, P, R and C cannot be separated without one of them.

    Raises:
        ValueError: A duration or time constant that is not positive.
    """
    tau = np.asarray(time_constant, dtype=float)
    if not (duration > 0 and np.all(tau > 0)):
        raise ValueError("final_rise: duration and time_constant must be above 0 s")
    return rise / -np.expm1(-duration / tau)


def fit_rise(time: ArrayLike, temperature: ArrayLike, ambient: float) -> tuple[float, float]:
    """Final rise R P (K) and time constant (s) by least squares, from readings (n,) at time (n,) s after the start.

    Loss and ambient temperature are taken as constant, and the start as at the ambient temperature.

    Raises:
        ValueError: Fewer than two readings after time 0, or readings too straight for a time constant below ten times
            their span.
    """
    t, rise = np.asarray(time, dtype=float), np.asarray(temperature, dtype=float) - ambient
    if t.ndim != 1 or t.shape != rise.shape or not (np.isfinite(t).all() and np.isfinite(rise).all()):
        raise ValueError("fit_rise: give as many finite temperatures as times, one axis each")
    if np.unique(t[t > 0]).size < 2:
        raise ValueError(
            "fit_rise: a final rise and a time constant need readings at two times after the start; "
            "with one, assume a time constant and use final_rise"
        )
    span = t.max()
    at_end = rise[t.argmax()]
    # tau in spans and the rise at the end of the record keep both unknowns near 1 and hardly correlated
    (end, tau), _ = scipy.optimize.curve_fit(
        lambda x, end, tau: end * np.expm1(-x / tau) / np.expm1(-1 / tau),
        t / span,
        rise,
        p0=(at_end or 1.0, 0.5),
        bounds=([-np.inf, 1e-3], [np.inf, 10.0]),
    )
    if tau > 9.99:
        raise ValueError(
            f"fit_rise: the readings rise too straight over {span:g} s to have a time constant; read on until they bend"
        )
    return float(end / -np.expm1(-1 / tau)), float(tau * span)
