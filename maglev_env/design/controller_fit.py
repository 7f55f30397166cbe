"""PID gains with filters from a controller that is known by numerator and denominator only."""

from collections.abc import Mapping
from dataclasses import fields, replace
from functools import reduce
from math import pi
from operator import mul
from typing import Any

import numpy as np
import scipy

from maglev_env.loop.filtered_pid import Filter, FilteredPid
from maglev_env.loop.gain_card import GainCard, stated_gains
from maglev_env.loop.gains import Gains, controller_response, gain_values, with_gains
from maglev_env.loop.linear_controller import LinearController

FREQUENCIES = 200  # logarithmic, from LOWEST to HIGHEST times the control rate
LOWEST, HIGHEST = 1e-4, 0.45
ENDS = {"td": (0.05, 1e3), "ti": (10.0, 1e7)}  # control steps; filters have those of their cards within FAR
FAR = (1e-3, 1e3)
STARTS = {"td": (0.5, 5.0, 50.0), "ti": (1e3, 1e6)}  # control steps
MOST = 0.05  # largest relative deviation of the response at which the fit is the same controller


def fitted_gains(controller: LinearController, filters: Mapping[str, Any], dt: float) -> Gains | FilteredPid:
    """PID gains and filters whose response is that of a linear controller.

    The relative deviation of the complex responses has least squares. For given time constants and filters kp, ki and
    kd follow by linear least squares; the others are searched, from several time constants and the given filters.

    Args:
        controller: a filter of the error, without a limit.
        filters: where the search starts, by their place in `FilteredPid`.
        dt: control step, s.

    Raises:
        ValueError: The controller does more than to filter the error, or its response deviates by more than MOST; the
            message says at which frequency.
    """
    if not controller.of_error:
        what = (
            "reads the current"
            if controller.reads_current
            else "has a limit"
            if controller.limit is not None
            else "treats the reference otherwise than the reading"
        )
        raise ValueError(f"its numerator and denominator do more than a PID with filters: the controller {what}")
    f = np.geomspace(LOWEST, HIGHEST, FREQUENCIES) / dt
    z = np.exp(2j * pi * f * dt)
    wanted = controller_response(controller, z, dt)
    if not wanted.all():
        raise ValueError("its numerator is zero: there is nothing to fit")
    start = FilteredPid(1.0, 0.0, 0.0, **filters)
    table = {name: card for name, _, card in stated_gains(start) if name not in ("kp", "ki", "kd")}
    names, ends = list(table), np.array([_ends(name, card, dt) for name, card in table.items()])

    def at(theta: np.ndarray) -> tuple[FilteredPid, np.ndarray]:
        """Gains with the best kp, ki and kd, and the relative deviation of their response (FREQUENCIES,)."""
        own: Any = with_gains(start, **dict(zip(names, np.exp(theta).tolist(), strict=True)))
        filtered = reduce(mul, (_response(one, z, dt) for one in own.filters.values()), np.ones(len(z)))
        units = [Gains(kp, ki, kd, own.td, own.ti) for kp, ki, kd in np.eye(3).tolist()]
        basis = np.array([controller_response(unit, z, dt) for unit in units])
        columns = (basis * filtered / wanted).T
        both = np.vstack([np.real(columns), np.imag(columns)])
        gains = np.linalg.lstsq(both, np.repeat([1.0, 0.0], len(z)), rcond=None)[0]
        return replace(own, **dict(zip(("kp", "ki", "kd"), gains.tolist(), strict=True))), columns @ gains - 1

    def residuals(theta: np.ndarray) -> np.ndarray:
        deviation = at(theta)[1]
        return np.concatenate([deviation.real, deviation.imag])

    tries = []
    for td in STARTS["td"]:
        for ti in STARTS["ti"]:
            begun = gain_values(replace(start, td=td * dt, ti=ti * dt))
            theta = np.log(np.clip([begun[name] for name in names], *(ends.T * [[1.001], [0.999]])))
            tries.append(scipy.optimize.least_squares(residuals, theta, bounds=np.log(ends.T), max_nfev=100))
    found, deviation = at(min(tries, key=lambda one: one.cost).x)
    worst = int(np.abs(deviation).argmax())
    if abs(deviation[worst]) > MOST:
        raise ValueError(
            f"no {' + '.join(['pid', *filters])} is the controller of its numerator and denominator: the nearest one "
            f"deviates by {abs(deviation[worst]):.0%} at {f[worst]:.3g} Hz; add or move filters, or give [gains]"
        )
    return found if filters else Gains(**{name.name: getattr(found, name.name) for name in fields(Gains)})


def _ends(name: str, card: GainCard, dt: float) -> tuple[float, float]:
    if name in ENDS:
        return ENDS[name][0] * dt, ENDS[name][1] * dt
    if card.unit == "Hz":
        return LOWEST / dt, HIGHEST / dt
    return max(card.low, FAR[0]), min(card.high, FAR[1])


def _response(one: Filter, z: np.ndarray, dt: float) -> np.ndarray:
    numerator, denominator = one.filter(dt)
    return np.polyval(numerator, z) / np.polyval(denominator, z)
