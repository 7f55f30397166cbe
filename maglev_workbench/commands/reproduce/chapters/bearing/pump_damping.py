"""The damping with which the linear model gives the published run-up: a peak at 10,000 rpm, 8 / 30 of it at 14,000."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy

from maglev_env.rotor.linear import closed_loop_poles
from maglev_env.rotor.parts import Runout
from maglev_env.rotor.rotor import Rotor
from maglev_workbench.commands.runup.study import readings

WORST, TOP = 10_000.0, 14_000.0  # rpm
FALL = 8 / 30
STEP = 100.0  # rpm, of the slope at the peak


def fall(rotor: Rotor) -> float:
    """Ratio of the radial reading at 14,000 rpm to the largest one from 4,000 rpm."""
    found = readings(rotor, np.arange(4000.0, TOP + 1, 1000.0))[:, 0]
    return float(found[-1] / found.max())


def with_inertia(rotor: Rotor, share: float) -> Rotor:
    """The rotor with its transverse inertia multiplied by `share`."""
    return replace(rotor, body=replace(rotor.body, transverse_inertia=share * rotor.body.transverse_inertia))


def forward_tilt(rotor: Rotor) -> tuple[float, float]:
    """Frequency (Hz) and damping ratio of the fastest mode of the loop below 400 Hz at 10,000 rpm."""
    z = closed_loop_poles(rotor, WORST * np.pi / 30)
    s = np.log(z[abs(z) > 1e-6]) * rotor.axis.control_rate
    s = s[(s.imag > 1) & (s.imag < 800 * np.pi)]
    fastest = s[s.imag.argmax()]
    return float(fastest.imag / (2 * np.pi)), float(-fastest.real / abs(fastest))


def asked_for(rotor: Rotor, by_lag: bool = False) -> tuple[Rotor, float, float]:
    """A rotor without runout whose linear response peaks at 10,000 rpm and falls as published, by other gains of both
    controllers: it, the factor of k_p, and that of k_d, or, by_lag, the amplifier lag (s) at the same k_d.

    RuntimeError when the search ends elsewhere.
    """
    rotor, lag = replace(rotor, runout=Runout()), rotor.axis.amplifier_time_constant
    make: Callable[[np.ndarray], Rotor] = (
        (lambda x: _changed(rotor, x[0], 1.0, x[1] * lag)) if by_lag else (lambda x: _changed(rotor, x[0], x[1], lag))
    )

    def missing(x: np.ndarray) -> list[float]:
        below, peak, above, top = readings(make(x), [WORST - STEP, WORST, WORST + STEP, TOP])[:, 0]
        return [(above - below) / peak * WORST / (2 * STEP), top / peak - FALL]

    x, _, good, why = scipy.optimize.fsolve(missing, [1.3, 4.0] if by_lag else [1.45, 0.45], full_output=True)
    if good != 1:
        raise RuntimeError(why)
    return make(x), float(x[0]), float(x[1] * (lag if by_lag else 1.0))


def _changed(rotor: Rotor, k_p: float, k_d: float, lag: float) -> Rotor:
    gains = {name: replace(g, kp=k_p * g.kp, kd=k_d * g.kd) for name, g in rotor.gains.items()}
    return replace(rotor, gains=gains, axis=replace(rotor.axis, amplifier_time_constant=lag))
