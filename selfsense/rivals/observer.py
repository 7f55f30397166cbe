"""A linear state observer of the averaged magnet: displacement from its current and voltage (D 2.6.2).

`averaged_signals` removes the ripple from the record of a switching supply, so that it can be given to observers.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from selfsense.rivals.averaged import AveragedMagnet, linear_model, observability, sampled


@dataclass(frozen=True, eq=False)
class Observer:
    """x' = transition (3, 3) x + voltage_gain (3,) u + current_gain (3,) i, from one sample to the next.

    States displacement (m), velocity (m/s) and current (A).
    """

    transition: np.ndarray
    voltage_gain: np.ndarray
    current_gain: np.ndarray


def design_observer(magnet: AveragedMagnet, rate: float, poles: ArrayLike) -> Observer:
    """Luenberger observer of the linear model, sampled exactly under a held voltage.

    A constant external force F makes the displacement wrong by F / stiffness for any poles, because it leaves the same
    trace in the current as a displacement.

    Args:
        magnet: Model.
        rate: Hz.
        poles: Poles (3,) of the error, 1/s: distinct, left of the imaginary axis, complex ones in pairs.

    Raises:
        ValueError: The poles do not fit, or the magnet is not observable.
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
    gain = scipy.signal.place_poles(transition.T, c.T, np.exp(poles / rate)).gain_matrix.T  # pyright: ignore[reportAttributeAccessIssue]
    return Observer(transition - gain @ c, inputs[:, 0], gain[:, 0])


def observe(observer: Observer, voltage: ArrayLike, current: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (m) and velocity (m/s), (..., n), each from the samples before it, starting at rest.

    Args:
        observer: The observer.
        voltage: (..., n), V, held from each sample to the next.
        current: (..., n), A.

    Raises:
        ValueError: The signals do not fit.
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
    """Ripple-free signals.

    Attributes:
        time: (n,), s.
        current: Mean over the PWM period around the time, (..., n), A.
        voltage: Voltage that, held until the next time, explains the current's change, (..., n), V.
    """

    time: np.ndarray
    current: np.ndarray
    voltage: np.ndarray


def averaged_signals(
    current: ArrayLike, switching: ArrayLike, voltage: float, rate: float, pwm_frequency: float
) -> AveragedSignals:
    """Average a rippling current over every PWM period, and its switching voltage so that the two belong together.

    The mean of a flux over a sliding period obeys the coil's equation with the sliding mean of the voltage. From the
    middle of one period to the middle of the next, that mean weights the two periods with a triangle. Edges between
    samples cause an error of the mean current of up to voltage pwm_frequency / (4 L rate^2).

    Args:
        current: (..., samples), A.
        switching: (..., samples): voltage over the supply's `voltage`, as its mean since the sample before (see
            `simulate` with every = 1). The first sample is 1 / rate after the start of the record.
        voltage: Of the supply, V.
        rate: Hz.
        pwm_frequency: Hz.

    Returns:
        Signals at n times, the number of whole periods less one.

    Raises:
        ValueError: Shapes differ, a period is not a whole number of samples, or there are fewer than two periods.
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
    """Both signals as finite arrays of one shape (..., n).

    Raises:
        ValueError: They are not; the message begins with `where`.
    """
    voltage, current = np.asarray(voltage, dtype=float), np.asarray(current, dtype=float)
    if current.ndim == 0 or current.shape[-1] == 0 or voltage.shape != current.shape:
        raise ValueError(f"{where}: voltage {voltage.shape} and current {current.shape} must be samples of one shape")
    for name, values in (("voltage", voltage), ("current", current)):
        if not np.all(np.isfinite(values)):
            raise ValueError(f"{where}: {name} holds values that are not finite; cut them out")
    return voltage, current
