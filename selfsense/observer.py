"""A linear state observer of the averaged magnet: displacement from its current and voltage (D 2.6.2).

`averaged_signals` takes the ripple out of a switching supply's record, so that observers can be given it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import place_poles

from selfsense.averaged import AveragedMagnet, linear_model, observability, sampled


@dataclass(frozen=True, eq=False)
class Observer:
    """x' = transition (3, 3) x + voltage_gain (3,) u + current_gain (3,) i, from one sample to the next.

    States displacement (m), velocity (m/s) and current (A).
    """

    transition: np.ndarray
    voltage_gain: np.ndarray
    current_gain: np.ndarray


def design_observer(magnet: AveragedMagnet, rate: float, poles: ArrayLike) -> Observer:
    """Luenberger observer of the linear model, sampled exactly under a held voltage at rate (Hz).

    poles (3,): of its error in 1/s, distinct, left of the imaginary axis, complex ones in pairs. A constant outer
    force F leaves the displacement wrong by F / stiffness whatever the poles: it and a displacement leave the same
    trace in the current. ValueError when the poles do not fit or the magnet is not observable.
    """
    poles = np.asarray(poles, dtype=np.complex128)
    if poles.shape != (3,) or len(set(poles.tolist())) < 3 or not np.all(poles.real < 0):
        raise ValueError(f"observer: poles = {poles} must be three distinct numbers left of the imaginary axis")
    if not np.allclose(np.sort_complex(poles), np.sort_complex(poles.conj())):
        raise ValueError(f"observer: poles = {poles}: complex poles must come in conjugate pairs")
    if not (np.isfinite(rate) and rate > 0):
        raise ValueError(f"observer: rate = {rate} Hz must be a positive number")
    rank, _ = observability(magnet)
    if rank < 3:
        raise ValueError("observer: the displacement leaves no trace in the current; it needs emf and stiffness")
    a, b, c = linear_model(magnet)
    transition, inputs = sampled(a, b, rate)
    gain = place_poles(transition.T, c.T, np.exp(poles / rate)).gain_matrix.T  # pyright: ignore[reportAttributeAccessIssue]
    return Observer(transition - gain @ c, inputs[:, 0], gain[:, 0])


def observe(observer: Observer, voltage: ArrayLike, current: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (m) and velocity (m/s), (..., n), each from the samples before it, beginning at rest.

    current (..., n), A; voltage (..., n), V, held from each sample to the next. ValueError when they do not fit.
    """
    voltage, current = checked_signals("observer", voltage, current)
    states = np.zeros((*current.shape, 3))
    for n in range(1, current.shape[-1]):
        states[..., n, :] = (
            states[..., n - 1, :] @ observer.transition.T
            + voltage[..., n - 1, None] * observer.voltage_gain
            + current[..., n - 1, None] * observer.current_gain
        )
    return states[..., 0], states[..., 1]


@dataclass(frozen=True)
class AveragedSignals:
    """Ripple-free signals (..., n): at time (n,) s the mean current (A) over the PWM period around it, and the voltage
    (V) that, held from there to the next, moves it."""

    time: np.ndarray
    current: np.ndarray
    voltage: np.ndarray


def averaged_signals(
    current: ArrayLike, switching: ArrayLike, voltage: float, rate: float, pwm_frequency: float
) -> AveragedSignals:
    """Average a rippling current over every PWM period, and its switching voltage so that the two belong together.

    current (..., samples) A; switching likewise, the voltage over the supply's `voltage` (V) as its mean since the
    sample before (`simulate`, every = 1); the first sample is 1 / rate (Hz) after the record's begin. The mean of a
    flux over a sliding period obeys the coil's equation with the sliding mean of the voltage; from one period's middle
    to the next that mean weighs two periods as a triangle. Edges between samples leave a mean current off by up to
    voltage pwm_frequency / (4 L rate^2). n is the number of whole periods less one. ValueError when shapes differ, a
    period is not a whole number of samples, or fewer than two periods are given.
    """
    current, switching = np.asarray(current, dtype=float), np.asarray(switching, dtype=float)
    if current.ndim == 0 or current.shape != switching.shape:
        raise ValueError(f"averaged signals: current {current.shape} and switching {switching.shape} must be one shape")
    per_period = round(rate / pwm_frequency)
    if per_period < 1 or abs(per_period * pwm_frequency / rate - 1) > 1e-9:
        raise ValueError(
            f"averaged signals: {rate:g} Hz is no whole multiple of the PWM frequency {pwm_frequency:g} Hz; "
            "sample at one"
        )
    periods = current.shape[-1] // per_period
    if periods < 2:
        raise ValueError(
            f"averaged signals: {current.shape[-1]} samples hold {periods} whole PWM periods; give 2 or more"
        )
    shape = (*current.shape[:-1], periods, per_period)
    means = current[..., : periods * per_period].reshape(shape).mean(axis=-1)
    levels = switching[..., : periods * per_period].reshape(shape)
    rising = np.arange(per_period) / per_period**2
    falling = 1 / per_period - rising
    held = voltage * (levels[..., :-1, :] @ rising + levels[..., 1:, :] @ falling)
    time = (np.arange(periods - 1) + 0.5) / pwm_frequency + 0.5 / rate
    return AveragedSignals(time, means[..., :-1], held)


def checked_signals(where: str, voltage: ArrayLike, current: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Both as finite arrays of one shape (..., n); ValueError names what is wrong `where`."""
    voltage, current = np.asarray(voltage, dtype=float), np.asarray(current, dtype=float)
    if current.ndim == 0 or current.shape[-1] == 0 or voltage.shape != current.shape:
        raise ValueError(f"{where}: voltage {voltage.shape} and current {current.shape} must be samples of one shape")
    for name, values in (("voltage", voltage), ("current", current)):
        if not np.all(np.isfinite(values)):
            raise ValueError(f"{where}: {name} holds values that are not finite; cut them out")
    return voltage, current
