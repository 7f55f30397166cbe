"""The parameter estimator as a linear periodic system around a converged orbit: its responses and its stability.

A wrong gap changes the slope of the simulated current in proportion to the switching voltage, the rectifier passes the
change with the sign of the ripple, and the low-pass averages it (D 6.2.1, 6.3); all of this repeats with the PWM. Eddy
currents, saturation, dead time and limits of the estimate are left out; `simulate` includes them.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from selfsense.coil import Coil
from selfsense.forward_path import response, unit_circle
from selfsense.sensor import SelfSensor, samples_and_periods
from selfsense.supply import Supply

LEAK = 1e-9  # least decay of a current per sample: a coil without resistance would have a pole on the unit circle
Sections = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Slopes:
    """A forward path on the orbit of a current of N samples.

    Attributes:
        rectifier: Slopes (N,) of the rectifier.
        root: Slopes (N,) of what follows the low-pass.
        amplitude: Mean amplitude, A.
    """

    rectifier: np.ndarray
    root: np.ndarray
    amplitude: float


@dataclass(frozen=True)
class LinearSensor:
    """A sensor at rest, linearised, without its PI gains. Sample k ends interval k of the N intervals of a cycle.

    Attributes:
        rate: Hz.
        sections: Filter sections before (n, 5) and behind (1, 5) the rectifier.
        estimate: Gap to which the estimator converges, m.
        decay: Decay of the simulated current over a sample.
        by_estimate: Change of the simulated current by the estimate of the sample before, (N,), A/m.
        simulated: Slopes for the simulated current.
        coil_decay: Decay of the coil's state over a sample; the state is a flux linkage, or a current without the
            back-EMF.
        by_gap: Change of that state by the gap at this sample, (N,).
        by_last_gap: Change of that state by the gap at the sample before, (N,).
        inverse: Reading = inverse state + direct gap.
        direct: See inverse, (N,).
        actual: Slopes for the real current.
    """

    rate: float
    sections: Sections
    estimate: float
    decay: float
    by_estimate: np.ndarray
    simulated: Slopes
    coil_decay: float
    by_gap: np.ndarray
    by_last_gap: np.ndarray
    inverse: float
    direct: np.ndarray
    actual: Slopes

    def forward(self, frequency: ArrayLike) -> np.ndarray:
        """Response of the simulated ripple's amplitude (A) to the estimated gap (m); frequency in Hz, any shape."""
        z, images = self._images(frequency)
        spectrum = np.fft.fft(self.by_estimate) / z / (1 - self.decay / images)
        return self._demodulated(self.simulated, spectrum, images).mean(axis=-1)

    def coil(self, frequency: ArrayLike) -> np.ndarray:
        """Response of the real ripple's amplitude (A) to the true gap (m); frequency in Hz, any shape."""
        return self._amplitude(*self._images(frequency)).mean(axis=-1)

    def tracked(self, kp: float, ki: float, frequency: ArrayLike) -> np.ndarray:
        """Ratio of estimated to true gap with gains kp (m/A) and ki (m/(A s)); frequency in Hz, any shape."""
        z, images = self._images(frequency)
        turn = z ** np.arange(self.direct.size)
        force = self._amplitude(z, images) * turn
        steps, rows, gains = self._steps(np.asarray(kp, dtype=float), np.asarray(ki, dtype=float))

        def cycle(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            estimates = np.empty_like(force)
            for k, (a, row) in enumerate(zip(steps, rows, strict=True)):
                state = a @ state + gains * (force[..., k, None, None] - row @ state)
                estimates[..., k] = state[..., -1, 0]
            return state, estimates

        forced, _ = cycle(np.zeros((*force.shape[:-1], len(gains), 1)))
        # A steady cycle ends where it began, multiplied by z^N.
        whole = (turn[..., -1:] * z)[..., None] * np.eye(len(gains))
        return (cycle(np.linalg.solve(whole - self.cycle_map(kp, ki), forced))[1] / turn).mean(axis=-1)

    def cycle_map(self, kp: ArrayLike, ki: ArrayLike) -> np.ndarray:
        """Matrix (..., n, n) of one cycle for small changes of the estimator's state, with gains kp and ki (...).

        The state holds the simulated current, two values of each section before and behind the rectifier, the integral
        and the estimate.
        """
        steps, rows, gains = self._steps(*np.broadcast_arrays(np.asarray(kp, dtype=float), np.asarray(ki, dtype=float)))
        total = np.broadcast_to(np.eye(steps.shape[-1]), (*gains.shape[:-1], steps.shape[-1]))
        for a, row in zip(steps, rows, strict=True):
            total = a @ total - gains * (row @ total)
        return total

    def growth(self, kp: ArrayLike, ki: ArrayLike) -> np.ndarray:
        """Long-run growth of a small error per cycle, for gains (...); the estimator is stable below 1."""
        return np.abs(np.linalg.eigvals(self.cycle_map(kp, ki))).max(axis=-1)

    def _images(self, frequency: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """z (..., 1) of frequencies, and z (..., N) of their images at the cycle's harmonics."""
        z = np.exp(2j * np.pi * np.asarray(frequency, dtype=float) / self.rate)[..., None]
        return z, z * unit_circle(self.direct.size)

    def _amplitude(self, z: np.ndarray, images: np.ndarray) -> np.ndarray:
        """Response of the amplitude (A) to the true gap (m) at each sample of a cycle, (..., N)."""
        state = np.fft.fft(self.by_gap + self.by_last_gap / z) / (1 - self.coil_decay / images)
        return self._demodulated(self.actual, self.inverse * state + np.fft.fft(self.direct), images)

    def _demodulated(self, slopes: Slopes, spectrum: np.ndarray, images: np.ndarray) -> np.ndarray:
        """Amplitude at each sample of a cycle (..., N), from the spectrum (..., N) of a current's images."""
        before, behind = self.sections
        ripple = np.fft.ifft(spectrum * response(before, images))
        amplitude = np.fft.ifft(np.fft.fft(ripple * slopes.rectifier) * response(behind, images))
        return amplitude * slopes.root

    def _steps(self, kp: np.ndarray, ki: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Steps (N, n, n) of the state without feedback, rows (N, 1, n) of the amplitude, and gains (..., n, 1)."""
        size = 3 + 2 * sum(map(len, self.sections))
        now = np.broadcast_to(np.eye(size), (self.by_estimate.size, size, size))
        value = self.decay * now[:, 0] + self.by_estimate[:, None] * now[:, -1]
        rows, at = [value], 1
        for sections, slope in zip(self.sections, (self.simulated.rectifier, self.simulated.root), strict=True):
            for b0, b1, b2, a1, a2 in sections:
                out = b0 * value + now[:, at]
                rows += [b1 * value - a1 * out + now[:, at + 1], b2 * value - a2 * out]
                value, at = out, at + 2
            value = value * slope[:, None]
        gains = np.zeros((*kp.shape, size, 1))
        gains[..., -2, 0], gains[..., -1, 0] = ki / self.rate, ki / self.rate + kp
        return np.stack([*rows, now[:, -2], now[:, -2]], axis=1), value[:, None], gains


def linearise(sensor: SelfSensor, drive: float = 0.0) -> LinearSensor:
    """A sensor linearised at its resting gap and a constant drive (-1 .. 1).

    Raises:
        ValueError: The current does not ripple at this drive, or no gap in the estimator's range gives the coil's
            amplitude.
    """
    _check_drive(sensor, drive)
    coil, model, rate = sensor.coil, sensor.estimator.coil, sensor.acquisition.rate
    sections, rms, interval = sensor.estimator.path.sections(rate), sensor.estimator.path.rms, 1 / rate
    integral, moment = _levels(sensor.supply, drive, *samples_and_periods(sensor))

    inverse, per_gap, decay = 1 / coil.inductance(sensor.gap), 2 / coil.constant, _decay(coil, sensor.gap, interval)
    # Volt-seconds late in an interval decay less than those at its start.
    late = coil.resistance * inverse * (moment - interval / 2 * integral)
    linkage = _steady(sensor.supply.voltage * (_phi(decay) * integral + late), decay)
    actual = _slopes(sections, rms, inverse * linkage)
    # Voltage lost in the resistance within an interval for a wider gap, half of it due to the gap at either end.
    within = sensor.supply.voltage * decay ** (2 / 3) * (interval * integral - moment)
    lost = coil.resistance * per_gap / 2 * (interval * decay * np.roll(linkage, 1) + within)
    if coil.back_emf:
        moved = coil.magnet_emf * _phi(decay)
        by_gap, by_last_gap = moved - lost, -moved - lost
        reading, direct = float(inverse), per_gap * linkage
    else:
        volts, ending = per_gap * sensor.supply.voltage, moment * rate
        by_gap = volts * decay ** (1 / 3) * ending - inverse * lost
        by_last_gap = volts * decay ** (2 / 3) * (integral - ending) - inverse * lost
        reading, direct = 1.0, np.zeros(linkage.size)

    estimate = _converged(sensor, integral, actual.amplitude, drive, sections)
    current, model_decay = _simulated_current(sensor, integral, estimate), _decay(model, estimate, interval)
    driving = sensor.estimator.voltage * integral - model.resistance * interval * np.roll(current, 1)
    by_estimate, simulated = 2 / model.constant * model_decay * driving, _slopes(sections, rms, current)
    estimator = (rate, sections, estimate, model_decay, by_estimate, simulated)
    return LinearSensor(*estimator, decay, by_gap, by_last_gap, reading, direct, actual)


def strongest_drive(supply: Supply) -> float:
    """The drive at which a supply's current ripples most: half duty."""
    return 0.5 if supply.states == 3 else 0.0


def forward_response(sensor: SelfSensor, frequency: ArrayLike, drive: float = 0.0) -> np.ndarray:
    """Complex response of the amplitude difference (A) to an error of the estimated gap (m) at the same frequency.

    It is the mean of the periodic response over the cycle, exact for the sampled estimator as a sum over the PWM
    harmonics, and includes the sample by which an estimate acts later. Shape of frequency (Hz).

    Raises:
        ValueError: As `linearise`.
    """
    return linearise(sensor, drive).forward(frequency)


def controller_response(kp: ArrayLike, ki: ArrayLike, rate: float, frequency: ArrayLike) -> np.ndarray:
    """The PI controller as sampled at rate (Hz), m/A, complex; gains and frequency (Hz, above 0) broadcast."""
    delay = np.exp(-2j * np.pi * np.asarray(frequency, dtype=float) / rate)
    return np.asarray(kp) + np.asarray(ki) / rate / (1 - delay)


def tracking(sensor: SelfSensor, frequency: ArrayLike, drive: float = 0.0) -> np.ndarray:
    """Complex ratio of estimated to true gap at frequencies (Hz) of any shape, for a stable sensor.

    It includes what the loop carries from one PWM harmonic to another and back. Without this part, which is below 1 %
    at half duty, it is C G_coil / (1 + C G_forward).

    Raises:
        ValueError: As `linearise`.
    """
    return linearise(sensor, drive).tracked(sensor.estimator.kp, sensor.estimator.ki, frequency)


def monodromy(sensor: SelfSensor, drive: float = 0.0) -> np.ndarray:
    """Matrix (n, n) of one cycle for small changes of the estimator's state, see `LinearSensor.cycle_map`.

    n is 7 with the digital path and 9 with the analog path.

    Raises:
        ValueError: As `linearise`.
    """
    return linearise(sensor, drive).cycle_map(sensor.estimator.kp, sensor.estimator.ki)


def stable(sensor: SelfSensor, drive: float = 0.0) -> bool:
    """Whether a small error of the estimator decays.

    Raises:
        ValueError: As `linearise`.
    """
    return bool(linearise(sensor, drive).growth(sensor.estimator.kp, sensor.estimator.ki) < 1)


def _check_drive(sensor: SelfSensor, drive: float) -> None:
    states = sensor.supply.states
    if not -1 < drive < 1 or (states == 3 and drive == 0):
        raise ValueError(
            f"drive = {drive}: the current of a {states}-state supply does not ripple there; give one between -1 and 1"
            + (", not 0" if states == 3 else "")
        )
    if drive and not (sensor.coil.resistance and sensor.estimator.coil.resistance):
        raise ValueError(f"drive = {drive}: a current without resistance grows without end; use drive 0")


def _levels(supply: Supply, drive: float, samples: int, periods: int) -> tuple[np.ndarray, np.ndarray]:
    """Integral (s) of the voltage levels over each interval of a cycle, and their first moment (s^2) from its start."""
    alpha, on, off = (abs(drive), np.sign(drive), 0.0) if supply.states == 3 else ((1 + drive) / 2, 1.0, -1.0)
    turns = np.arange(samples + 1) * periods
    whole, part, step = turns // samples, turns % samples / samples, periods / samples
    first, rest = np.minimum(part, alpha), np.maximum(part - alpha, 0)
    # The running integral and its own integral, in periods: of whole periods, and of what follows them.
    mean, area = on * alpha + off * (1 - alpha), on * alpha * (1 - alpha / 2) + off * (1 - alpha) ** 2 / 2
    once = whole * mean + on * first + off * rest
    twice = whole * (area + mean * ((whole - 1) / 2 + part)) + on * first * (first / 2 + rest) + off * rest**2 / 2
    # By parts: the moment is the interval times the integral at its end, minus the area under it.
    return np.diff(once) / supply.frequency, (step * once[1:] - np.diff(twice)) / supply.frequency**2


def _decay(coil: Coil, gap: float, interval: float) -> float:
    return float(np.exp(-max(coil.resistance * interval / coil.inductance(gap), LEAK)))


def _phi(decay: float) -> float:
    """(1 - e^-x) / x."""
    return float((decay - 1) / np.log(decay))


def _steady(driving: np.ndarray, decay: float) -> np.ndarray:
    """The periodic solution y (N,) of y_k = decay y_k-1 + driving_k."""
    return np.fft.ifft(np.fft.fft(driving) / (1 - decay / unit_circle(driving.size))).real


def _simulated_current(sensor: SelfSensor, integral: np.ndarray, gap: float) -> np.ndarray:
    model = sensor.estimator.coil
    decay = _decay(model, gap, 1 / sensor.acquisition.rate)
    return _steady(sensor.estimator.voltage * integral / model.inductance(gap) * _phi(decay), decay)


def _converged(sensor: SelfSensor, integral: np.ndarray, amplitude: float, drive: float, sections: Sections) -> float:
    """The gap (m) at which the simulated ripple has an amplitude (A)."""

    def excess(gap: float) -> float:
        current = _simulated_current(sensor, integral, gap)
        return _slopes(sections, sensor.estimator.path.rms, current).amplitude - amplitude

    low, high = sensor.estimator.gap_range
    if excess(low) >= 0 or excess(high) <= 0:
        raise ValueError(
            f"estimator: no gap in its range {low} .. {high} m has the coil's amplitude, {amplitude:.3g} A at a drive "
            f"of {drive}; correct its coil and voltage, or widen gap_range"
        )
    return scipy.optimize.brentq(excess, low, high, xtol=1e-12)  # pyright: ignore[reportReturnType]  # full_output is False


def _slopes(sections: Sections, rms: bool, current: np.ndarray) -> Slopes:
    """The slopes of a forward path on the orbit of a current (N,)."""
    before, behind = sections
    unity = unit_circle(current.size)
    ripple = np.fft.ifft(np.fft.fft(current) * response(before, unity)).real
    mean = np.fft.ifft(np.fft.fft(ripple**2 if rms else np.abs(ripple)) * response(behind, unity)).real
    if not rms:
        return Slopes(np.sign(ripple), np.ones(current.size), mean.mean())
    root = np.sqrt(mean)
    return Slopes(2 * ripple, 0.5 / root, root.mean())
