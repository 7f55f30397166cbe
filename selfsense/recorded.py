"""The parameter estimator on recorded coil current and switching voltage, with the same filter as in simulation."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from maglev_lanes.compiled import compiled
from maglev_lanes.layout import LANES, row
from selfsense.forward_path import AnalogPath, ForwardPath, response
from selfsense.kernel_pieces import SensorStructure, sensor_pieces
from selfsense.kernel_rows import ESTIMATE, FORWARD, MODEL, SENSOR_ROWS
from selfsense.sensor import Estimator, SelfSensor, sensor_rows
from selfsense.supply import Acquisition, Supply, check_rates
from selfsense.validity import AT_END, CLIPPED, CONVERGING, LOST, NO_RIPPLE, WRONG_READING, Stretch, gap_validity

W = LANES
_CARRIER = 0.05  # least share of the power: pulses of 3 % duty hold more in their fundamental, white noise less
MOST_PERIODS = 0.9  # of a record, which show what is usual
UNUSUAL = 4.0  # times what is usual
WRONG = 0.05  # of the ripple from peak to peak
_REMEDIES = {
    LOST: "they are missing in the file; record again without losses",
    CLIPPED: "the current stays on the end of its converter's range; check its scale, or widen that range",
    WRONG_READING: "single readings of current or voltage fit no other; look for lost or disturbed samples",
    NO_RIPPLE: "the current carries no ripple of the switching voltage; check both channels, their scales and the duty",
    AT_END: "correct the believed coil, the channels' scales, or gap_range",
    CONVERGING: "the estimator never settles in it; record longer, or raise ki",
}


@dataclass(frozen=True)
class RecordedGap:
    """A gap from recorded signals.

    Attributes:
        time: From the first sample, (samples,), s.
        gap: Estimated gap, (samples,), m; nan where invalid.
        amplitude: Amplitude of the ripple behind the forward path, (samples,), A.
        valid: Where the gap can be trusted, (samples,).
        reasons: The stretches where it cannot.
        pwm_frequency: Hz.
    """

    time: np.ndarray
    gap: np.ndarray
    amplitude: np.ndarray
    valid: np.ndarray
    reasons: tuple[Stretch, ...]
    pwm_frequency: float


def estimate_recorded(
    current: ArrayLike,
    voltage: ArrayLike,
    rate: float,
    estimator: Estimator,
    gap: float,
    current_range: float,
    voltage_sampling: Literal["mean", "point"] = "mean",
    pwm_frequency: float | None = None,
    lost: ArrayLike = False,
) -> RecordedGap:
    """Estimate the gap from coil current and switching voltage that were sampled together.

    Args:
        current: (samples,), A.
        voltage: (samples,), V. It is measured, so `estimator.voltage` is not used.
        rate: Hz.
        estimator: The estimator.
        gap: Where the estimate starts, m.
        current_range: Range of the converter that read the current, A; inf where it cannot clip. Readings within 1 %
            of it count as clipped.
        voltage_sampling: "mean" since the sample before, as a timer or an integrator reads it, which is exact; or
            "point", instants joined by the trapezoid rule, which misplaces an edge by up to half a sample. Simulated
            with a duty within 0.1 of one half, the gap is then wrong by up to 10 % at 10 samples per PWM period, 1.5 %
            at 40 and 0.6 % at 100; by a third of that where the samples drift against the switching, which turns a
            part of the error into noise.
        pwm_frequency: Hz; by default found in the voltage, where one above half the rate is taken for its alias.
        lost: Where current and voltage only stand for what was not recorded, (samples,).

    Raises:
        ValueError: The samples do not fit each other, are not finite, or are slower than twice the PWM frequency (ten
            times for instants); the voltage does not switch; or no sample carries a gap.
    """
    current, volts = _series("current", current), _series("voltage", voltage)
    if current.size != volts.size:
        raise ValueError(
            f"current has {current.size} samples and voltage {volts.size}: they differ from sample "
            f"{min(current.size, volts.size)} on; give both at one rate, over the same time"
        )
    acquisition = Acquisition(rate)
    if not current_range > 0:
        raise ValueError(f"current_range = {current_range} A must be positive; inf where the current cannot clip")
    if voltage_sampling not in ("mean", "point"):
        raise ValueError(f"voltage_sampling = {voltage_sampling!r}; use 'mean' or 'point'")
    if not estimator.ki > 0:
        raise ValueError("estimator: ki = 0 never removes an error; give a positive ki")
    if pwm_frequency is None:
        pwm_frequency = find_pwm_frequency(volts, rate, estimator.path)
    check_rates(Supply(frequency=pwm_frequency), acquisition)
    # The estimator depends on the supply through its voltage only: any PWM frequency gives it the same rows.
    stand_in = Supply(frequency=rate / 2)
    sensor = SelfSensor(estimator.coil, stand_in, acquisition, replace(estimator, voltage=1.0), gap)
    block = np.zeros((SENSOR_ROWS, W))
    block[:, 0] = sensor_rows([sensor])[:, 0]
    block[row(MODEL), 0] = current[0]  # both paths then start from the same step, so their difference starts from zero
    if voltage_sampling == "point":
        _check_instants(rate, pwm_frequency)
        volts = np.concatenate([volts[:1], (volts[1:] + volts[:-1]) / 2])
    estimate, amplitude = np.empty(current.size), np.empty(current.size)
    _recorder(estimator.path.rms)(block.reshape(-1), current, volts / rate, estimate, amplitude)
    clipped = np.abs(current) >= 0.99 * current_range
    noise_only = _noise_only(current, volts, amplitude, rate, pwm_frequency, estimator.path)
    driving = volts[1:] - estimator.coil.resistance * (current[1:] + current[:-1]) / 2
    wrong = _wrong_readings(current, driving, rate / pwm_frequency, voltage_sampling == "point")
    supply = (usual_peak(volts, rate / pwm_frequency), pwm_frequency)
    found = gap_validity(estimate, amplitude, rate, estimator, *supply, clipped, noise_only, wrong, lost)
    if not found.valid.any():
        _refuse(found.reasons, current.size)
    estimate[~found.valid] = np.nan
    return RecordedGap(np.arange(current.size) / rate, estimate, amplitude, found.valid, found.reasons, pwm_frequency)


def find_pwm_frequency(voltage: ArrayLike, rate: float, path: ForwardPath, least: float | None = None) -> float:
    """Switching frequency (Hz) of a voltage (samples,): its strongest line that the forward path passes.

    The resolution is 1 / record length. Below `least` (Hz) lies the drive, by default below a tenth of the path's
    corner; where the switching is about known, give a part of it, and a drive of some kHz is not taken for it.

    Raises:
        ValueError: No line stands out.
    """
    volts = np.asarray(voltage, dtype=float)
    power = np.abs(np.fft.rfft((volts - volts.mean()) * np.hanning(volts.size))) ** 2
    frequency = np.fft.rfftfreq(volts.size, 1 / rate)
    least = least or (path.centre if isinstance(path, AnalogPath) else path.high_pass) / 10
    power[frequency < least] = 0.0
    # Take the lowest of the strong lines, because sampling can make a harmonic the strongest; then the peak around it.
    lowest = frequency[np.argmax(power >= 0.25 * power.max())]
    near = np.abs(frequency - lowest) <= np.maximum(0.02 * lowest, 2 * frequency[1])
    top = int(np.argmax(np.where(near, power, 0.0)))
    if not power[near].sum() > _CARRIER * power.sum() or not power[top] > 0:
        raise ValueError(
            f"voltage: no switching stands out above {least:g} Hz in its {volts.size} samples; record the coil's "
            "switching voltage"
        )
    return float(frequency[top])


def usual_peak(values: np.ndarray, period: float) -> float:
    """The largest magnitude of a PWM period (samples), in most periods: single readings do not count."""
    width = min(max(round(period), 2), values.size)
    count = values.size // width
    return float(np.quantile(np.abs(values[: count * width]).reshape(count, width).max(axis=1), MOST_PERIODS))


@cache
def _recorder(rms: bool) -> Callable[..., None]:
    """The compiled loop over samples, for lane 0 of a block."""
    sources = 0  # see `compiled`
    *_, converge = sensor_pieces(SensorStructure(rms, False, False, False, False, False, False, False))

    def run(x, current, volt_seconds, estimate, amplitude):
        if sources == 0:
            return
        for n in range(current.size):
            converge(x, 0, current[n], volt_seconds[n])
            estimate[n] = x[ESTIMATE]
            amplitude[n] = x[FORWARD]

    return compiled(run)


def _series(name: str, values: ArrayLike) -> np.ndarray:
    values = np.ascontiguousarray(values, dtype=float)
    if values.ndim != 1 or values.size < 2:
        raise ValueError(f"{name} has the shape {values.shape}; give two samples or more, (samples,)")
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise ValueError(
            f"{name}: sample {bad[0]} is {values[bad[0]]} ({bad.size} such samples); cut the record there or mend it"
        )
    return values


def _check_instants(rate: float, pwm_frequency: float) -> None:
    if rate < 10 * pwm_frequency * (1 - 1e-3):
        raise ValueError(
            f"voltage_sampling = 'point' at {rate / pwm_frequency:.3g} samples per PWM period misplaces its edges too "
            f"far; sample at {10 * pwm_frequency:g} Hz or faster, or record the mean since the sample before"
        )


def _noise_only(
    current: np.ndarray, volts: np.ndarray, amplitude: np.ndarray, rate: float, frequency: float, path: ForwardPath
) -> np.ndarray:
    """Where the voltage does not switch, or the amplitude (A) is not that of a ripple at the switching frequency.

    The fundamental of a ripple is 0.78 (duty near 0 or 1) to 1 of its amplitude; that of noise is about 0.2.
    """
    window = max(round(8 * rate / frequency), 64)
    mixer = np.exp(-2j * np.pi * frequency / rate * np.arange(current.size))
    ripple, switching = (
        2 * np.abs(scipy.ndimage.uniform_filter1d((x - scipy.ndimage.uniform_filter1d(x, window)) * mixer, window))
        for x in (current, volts)
    )
    before, ((*b, a1, a2),) = path.sections(rate)
    gain = np.abs(response(before, np.exp(2j * np.pi * frequency / rate)))
    expected = ripple * gain * (1 / np.sqrt(2) if path.rms else 2 / np.pi)
    expected = scipy.signal.lfilter(b, [1, a1, a2], expected)  # delayed as much as the amplitude
    return (expected < 0.5 * amplitude) | (switching < 0.05 * usual_peak(volts, rate / frequency))


def _wrong_readings(current: np.ndarray, driving: np.ndarray, period: float, instants: bool) -> np.ndarray:
    """Where the current changes otherwise than in proportion to what drives it, as the samples around show it.

    What is off in every period of the PWM is how both channels are read. A sample that is off by several times as much,
    and by a part of the ripple, is disturbed; a single one can move the estimate by much of the gap.

    Args:
        current: (samples,), A.
        driving: Voltage on the inductance, mean between a sample and the next, (samples - 1,), V.
        period: Samples per PWM period.
        instants: Whether that mean is joined from instants, which misplaces edges by up to half a sample.
    """
    window = max(round(8 * period), 64)
    change, drive, ripple = (
        x - scipy.ndimage.uniform_filter1d(x, window) for x in (np.diff(current), driving, current)
    )
    both, square = (scipy.ndimage.uniform_filter1d(drive * x, window) for x in (change, drive))
    off = np.abs(change - drive * both / np.maximum(square, np.finfo(float).tiny))
    least = 1.5 * usual_peak(change, period) if instants else 2 * WRONG * usual_peak(ripple, period)
    return np.concatenate([[False], off > max(UNUSUAL * usual_peak(off, period), least)])


def _refuse(reasons: tuple[Stretch, ...], samples: int) -> None:
    lengths = {r: sum(s.stop - s.start for s in reasons if s.reason == r) for r in _REMEDIES}
    # _REMEDIES begins with faults that cause others. Convergence is not a cause, so it counts as 5 % of the samples,
    # however long it lasts.
    worst = max(lengths, key=lambda r: round(10 * lengths[r] / samples) if r != CONVERGING else 0.5)
    first = next(s for s in reasons if s.reason == worst)
    raise ValueError(
        f"no sample of {samples} carries a gap: {worst!r} for {lengths[worst]} of them, first at sample {first.start}: "
        f"{_REMEDIES[worst]}"
    )
