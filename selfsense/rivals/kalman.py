"""An extended Kalman filter of the averaged magnet, and how it and the observer tolerate unknown disturbances."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import ArrayLike

from selfsense.rivals.averaged import CLOSEST, AveragedMagnet, jacobian, levitate, linear_model, slopes
from selfsense.rivals.observer import checked_signals, design_observer, observe

# A running mean over MEMORY samples of the squared innovation, in its claimed variance, that no rotor causes.
MEMORY, LOST = 200, 1e8

POLES = (-40.0, -3000.0, -5000.0)  # 1/s: near those of the filter's steady state with the noise `compare` assumes


class MagnetFilter(ExtendedKalmanFilter):
    """Predicts displacement, velocity and current of an averaged magnet by its nonlinear model; see `run`."""

    def __init__(self, magnet: AveragedMagnet, rate: float, process: np.ndarray, current_noise: float) -> None:
        super().__init__(dim_x=3, dim_z=1)
        self.magnet, self.interval = magnet, 1 / rate
        self.x, self.Q, self.R = np.zeros(3), process, np.array([[current_noise**2]])

    def predict_x(self, u: float = 0.0) -> None:
        """One sample under a held voltage u (V): Runge-Kutta of 4th order, and its transition F."""
        m, h, x = self.magnet, self.interval, self.x.tolist()
        a = h * jacobian(m, *x, voltage=u)
        # The effect of the voltage on the current depends on the displacement through the inductance. Where the voltage
        # is wrong, or feeds back a displacement measured otherwise, this would be taken for information on the
        # displacement: estimates were then off by 36 µm where the filter claimed 12.
        a[2, 0] = 0.0
        self.F = self._I + a @ (self._I + a @ (self._I + a @ (self._I + a / 4) / 3) / 2)
        k1 = slopes(m, *x, u)
        k2 = slopes(m, *_ahead(x, k1, h / 2), u)
        k3 = slopes(m, *_ahead(x, k2, h / 2), u)
        k4 = slopes(m, *_ahead(x, k3, h), u)
        self.x = self.x + h * (np.array([1.0, 2.0, 2.0, 1.0]) / 6 @ np.array([k1, k2, k3, k4]))


def _ahead(x: Sequence[float], rate: Sequence[float], time: float) -> list[float]:
    return [p + time * d for p, d in zip(x, rate, strict=True)]


def process_noise(magnet: AveragedMagnet, rate: float, force_noise: float, voltage_noise: float = 0.0) -> np.ndarray:
    """Covariance (3, 3) per sample from white force (N/sqrt(Hz)) and voltage (V/sqrt(Hz)) noise, one-sided.

    It is exact for the linear model (Van Loan 1978).
    """
    a, _, _ = linear_model(magnet)
    block = np.zeros((6, 6))
    block[:3, :3], block[3:, 3:] = -a, a.T
    block[1, 4], block[2, 5] = force_noise**2 / 2 / magnet.mass**2, voltage_noise**2 / 2 / magnet.inductance**2
    e = scipy.linalg.expm(block / rate)
    covariance = e[3:, 3:].T @ e[:3, 3:]
    return (covariance + covariance.T) / 2


def run(
    magnet: AveragedMagnet,
    voltage: ArrayLike,
    current: ArrayLike,
    rate: float,
    force_noise: float,
    current_noise: float,
    voltage_noise: float = 0.0,
    start_deviation: ArrayLike | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate the displacement from current and voltage, each estimate from the samples up to it.

    Estimates end at 95 % of the gap. A constant force stays unseen, as in `design_observer`.

    Args:
        magnet: Model.
        voltage: (n,), V, held from each sample to the next.
        current: (n,), A.
        rate: Hz.
        force_noise: White force on the rotor, N/sqrt(Hz), one-sided.
        current_noise: White noise of the current, A rms per sample.
        voltage_noise: White error of the voltage, V/sqrt(Hz), one-sided.
        start_deviation: Deviation of displacement, velocity and current from rest at the start, (3,); by default a
            30th of the magnet's units. Up to that the claimed deviation holds; a tenth off, it holds after 10 to
            30 ms.

    Returns:
        Displacement (n,), m, and the standard deviation (n,) that the filter claims for it.

    Raises:
        ValueError: An input does not fit, or the record does not match the magnet at all.
    """
    voltage, current = checked_signals("Kalman filter", voltage, current)
    if current.ndim != 1:
        raise ValueError(f"Kalman filter: current has the shape {current.shape}; give one record (samples,)")
    for name, value in (("rate", rate), ("current_noise", current_noise)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"Kalman filter: {name} = {value} must be a positive number")
    for name, value in (("force_noise", force_noise), ("voltage_noise", voltage_noise)):
        if not (np.isfinite(value) and value >= 0):
            raise ValueError(f"Kalman filter: {name} = {value} must be at least 0")
    start_deviation = magnet.units / 30 if start_deviation is None else np.asarray(start_deviation, dtype=float)
    if start_deviation.shape != (3,) or not np.all(start_deviation >= 0):
        raise ValueError(f"Kalman filter: start_deviation = {start_deviation} must be three numbers of at least 0")
    f = MagnetFilter(magnet, rate, process_noise(magnet, rate, force_noise, voltage_noise), current_noise)
    f.P = np.diag(start_deviation) ** 2
    seen, limit = np.array([[0.0, 0.0, 1.0]]), CLOSEST * magnet.gap
    found, surprise = np.empty((2, len(current))), 1.0
    for n in range(len(current)):
        if n:
            f.predict(voltage[n - 1])
        f.update(current[n : n + 1], lambda _: seen, lambda x: x[2:])
        if abs(f.x[0]) > limit:
            f.x[:2] = np.copysign(limit, f.x[0]), 0.0  # a contact stops the rotor
        surprise += (float(np.ravel(f.y)[0]) ** 2 / float(np.ravel(f.S)[0]) - surprise) / MEMORY
        if not f.P[0, 0] > 0 or surprise > LOST:
            raise ValueError(
                f"Kalman filter: lost at sample {n}, current and voltage do not fit this magnet; check their signs, "
                "and resistance and inductance"
            )
        found[:, n] = f.x[0], np.sqrt(f.P[0, 0])
    return found[0], found[1]


def compare(
    magnet: AveragedMagnet,
    force_noise: float = 0.01,
    current_noise: float = 2e-3,
    voltage_noise: float = 1e-4,
    poles: ArrayLike = POLES,
    rate: float = 25e3,
    duration: float = 0.4,
    step: float = 0.5,
    seed: int = 0,
) -> dict[str, dict[str, float]]:
    """Errors of observer and filter, both designed for `magnet`, on records of magnets that differ from it.

    The records come from the nonlinear model, levitated by its true state under the noise of `run`. The estimates do
    not close the loop; if the filter's estimates did, an error of a fifth in resistance or supply would drop the rotor
    within 0.1 s.

    Returns:
        Rows: nominal; resistance, supply voltage and inductance each 20 % above the assumed value; a force step (N) at
        a third of the record. Columns, rms in µm over the second half: the motion itself, the error of the observer
        (its `poles` in 1/s) and of the filter; and the filter's claimed standard deviation at the end.
    """
    n = round(duration * rate)
    rng = np.random.default_rng(seed)
    force = rng.normal(0.0, force_noise * np.sqrt(rate / 2), n)
    heard = rng.normal(0.0, current_noise, n)
    told = rng.normal(0.0, voltage_noise * np.sqrt(rate / 2), n)
    hot = replace(magnet, resistance=1.2 * magnet.resistance)
    rich = replace(magnet, inductance=1.2 * magnet.inductance)
    stepped = force + step * (np.arange(n) >= n // 3)
    seen = levitate([magnet, hot, rich, magnet], np.array([force, force, force, stepped]), rate)
    observer = design_observer(magnet, rate, poles)
    rows = {}
    for name, lane, supply in (
        ("nominal", 0, 1.0),
        ("resistance +20 %", 1, 1.0),
        ("supply +20 %", 0, 1.2),
        ("inductance +20 %", 2, 1.0),
        (f"force step {step:g} N", 3, 1.0),
    ):
        signals = (seen.voltage[lane] / supply + told, seen.current[lane] + heard)
        moved = seen.displacement[lane]
        observed, _ = observe(observer, *signals)
        filtered, deviation = run(magnet, *signals, rate, force_noise, current_noise, voltage_noise)
        rows[name] = {
            "motion": _late_rms(moved),
            "observer": _late_rms(observed - moved),
            "filter": _late_rms(filtered - moved),
            "filter claims": 1e6 * float(deviation[-1]),
        }
    return rows


def _late_rms(values: np.ndarray) -> float:
    """Root mean square of the second half, in units of 1e-6."""
    return 1e6 * float(np.sqrt(np.mean(values[len(values) // 2 :] ** 2)))
