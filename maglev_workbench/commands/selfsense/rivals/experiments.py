"""Observer, Kalman filter and parameter estimator on the same levitated motion, switching edge by switching edge.

Observer and filter get ideal conditions: one equivalent coil with the largest back-EMF that conservation of energy
allows, its current averaged over every PWM period from many samples, and the known strength of the force. All three
use the parameters of the nominal rig.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import Rig, axis_rig
from selfsense.coil import Coil
from selfsense.rivals.averaged import AveragedMagnet, Levitation, levitate, linear_model, sampled
from selfsense.rivals.kalman import process_noise, run
from selfsense.rivals.observer import averaged_signals, design_observer, observe
from selfsense.sensor import SelfSensor
from selfsense.simulate import simulate

NAMES = ("observer", "kalman", "estimator")
PARTS = 10  # of a levitation, between looks at the progress bar
CHANGE, GIVES_WAY = 1.2, 0.04  # mismatches; share of the gap by which a force step moves the levitated rotor
AVERAGED = 40  # samples of the rivals' current per PWM period
_LENGTH, _SECONDS = 340.0, (0.1, 0.8)  # of a record, in time scales of the magnet and in s
# In natural units: white force on the rotor, what the filter assumes of current and voltage.
_FORCE_NOISE, _CURRENT_NOISE, _VOLTAGE_NOISE = 0.015, 5.7e-4, 1.7e-3


@dataclass(frozen=True)
class Case:
    """A rig as it is (magnet, coil, supply voltage in V), the magnet that the rivals believe in, and a force step (N)
    after a third of the record."""

    name: str
    magnet: AveragedMagnet
    coil: Coil
    voltage: float
    believed: AveragedMagnet
    step: float = 0.0


@dataclass(frozen=True)
class Result:
    """One case. time (n,) s, position and the readings of the rivals (n,) m, one per PWM period; own_time (m,) and
    estimator (m,): of the parameter estimator at its own rate. Rms over the second half, m: motion; errors, by NAMES;
    fitted: errors after the offset and gain that fit the record best; claim: the filter's own standard deviation."""

    case: Case
    time: np.ndarray
    position: np.ndarray
    observer: np.ndarray
    kalman: np.ndarray
    own_time: np.ndarray
    estimator: np.ndarray
    motion: float
    errors: dict[str, float]
    fitted: dict[str, float]
    claim: float


@dataclass(frozen=True)
class Rivalry:
    """All cases; force_noise (N/sqrt(Hz)) on the rotor; seconds of a record; poles (3,) of the observer, 1/s."""

    rig: Rig
    sensor: SelfSensor
    seed: int
    force_noise: float
    seconds: float
    poles: np.ndarray
    results: tuple[Result, ...]


def cases(rig: Rig, sensor: SelfSensor) -> list[Case]:
    """Nominal, mismatches and a force step. ValueError when the rig's magnet is not observable from its current."""
    own, gap = axis_rig(rig, 0), sensor.gap + sensor.coil.core_length / 2
    gain, stiffness = linearise(force_law(own))
    inductance = float(sensor.coil.inductance(sensor.gap))
    stiffness += own.support_stiffness
    # Of one coil that does the work of all: no energy is lost where EMF per speed and force per current are one number.
    nominal = AveragedMagnet(
        own.mass, gain, stiffness, inductance, sensor.coil.resistance, gain, gap, own.support_damping
    )
    poles_of(nominal, sensor.supply.frequency)
    coil, volts = replace(sensor.coil, magnet_emf=gain), sensor.supply.voltage
    hot, rich = ({name: CHANGE * getattr(nominal, name)} for name in ("resistance", "inductance"))
    found = [
        Case("nominal", nominal, coil, volts, nominal),
        Case("resistance +20 %", replace(nominal, **hot), replace(coil, **hot), volts, nominal),
        Case("supply voltage +20 %", nominal, coil, CHANGE * volts, nominal),
        Case("inductance +20 %", replace(nominal, **rich), _richer(coil), volts, nominal),
        Case("force step", nominal, coil, volts, nominal, _step(nominal)),
    ]
    if 0 < sensor.coil.magnet_emf < gain:
        weak = replace(nominal, emf=sensor.coil.magnet_emf)
        found.append(Case("back-EMF of one coil, known", weak, sensor.coil, volts, weak))
    return found


def compare(
    rig: Rig, sensor: SelfSensor, planned: Sequence[Case], seed: int, progress: Callable[[], None] = lambda: None
) -> Rivalry:
    """Levitate every case under one random force and estimate its motion three ways. ValueError when one touches."""
    nominal, rate = planned[0].magnet, sensor.supply.frequency
    seconds = float(np.clip(_LENGTH * nominal.time_scale, *_SECONDS))
    n = round(seconds * rate)
    noise = _noise(nominal)[0]
    force = np.random.default_rng(seed).normal(0.0, noise * np.sqrt(rate / 2), n)
    forces = np.stack([force + c.step * (np.arange(n) >= n // 3) for c in planned])
    motion = _levitate([c.magnet for c in planned], forces, rate, sensor.supply.voltage, progress)
    results = []
    for lane, case in enumerate(planned):
        own = Levitation(*(w[lane] for w in (getattr(motion, name) for name in _CHANNELS)))
        results.append(_result(sensor, case, own, seed))
        progress()
    return Rivalry(rig, sensor, seed, noise, seconds, poles_of(nominal, rate), tuple(results))


def poles_of(magnet: AveragedMagnet, rate: float) -> np.ndarray:
    """Poles (3,), 1/s, of the steady Kalman filter of the linear model: the observer of the least error.

    ValueError when displacement leaves no trace in the current.
    """
    force, current, voltage = _noise(magnet)
    a, b, c = linear_model(magnet)
    transition, _ = sampled(a, b, rate)
    try:
        p = scipy.linalg.solve_discrete_are(
            transition.T, c.T, process_noise(magnet, rate, force, voltage), [[current**2]]
        )
    except np.linalg.LinAlgError:
        raise ValueError(
            "rivals: no steady observer of this magnet exists; it needs a negative stiffness and an actuator gain"
        ) from None
    gain = transition @ p @ c.T / (p[2, 2] + current**2)
    return np.log(np.linalg.eigvals(transition - gain @ c).astype(complex)) * rate


_CHANNELS = ("displacement", "velocity", "current", "voltage", "force")


def _noise(magnet: AveragedMagnet) -> tuple[float, float, float]:
    """Force (N/sqrt(Hz)), current (A rms) and voltage (V/sqrt(Hz)) noise."""
    current, root = magnet.units[2], np.sqrt(magnet.time_scale)
    force = magnet.actuator_gain * current
    return (
        float(_FORCE_NOISE * force * root),
        float(_CURRENT_NOISE * current),
        float(_VOLTAGE_NOISE * magnet.inductance * current / root),
    )


def _step(magnet: AveragedMagnet) -> float:
    """A force (N) that moves the levitated rotor by GIVES_WAY of the gap in the steady state."""
    rate, small = 25 / magnet.time_scale, 1e-3 * magnet.actuator_gain * magnet.units[2]
    ends = levitate(magnet, np.full(500, small), rate).displacement[-1]
    return float(small * GIVES_WAY * magnet.gap / ends)


def _richer(coil: Coil) -> Coil:
    return replace(coil, pole_area=CHANGE * coil.pole_area)


def _levitate(
    magnets: list[AveragedMagnet], force: np.ndarray, rate: float, voltage: float, progress: Callable[[], None]
) -> Levitation:
    """`levitate` in PARTS, each from where the one before ended."""
    start, found = np.zeros((len(magnets), 3)), []
    for part in np.array_split(np.arange(force.shape[1] - 1), PARTS):
        span = slice(part[0], part[-1] + 2)
        one = levitate(magnets, force[:, span], rate, voltage, start)
        start = np.stack([one.displacement[:, -1], one.velocity[:, -1], one.current[:, -1]], axis=-1)
        found.append([getattr(one, name)[:, :-1] for name in _CHANNELS])
        progress()
    return Levitation(*(np.concatenate(parts, axis=1) for parts in zip(*found, strict=True)))


def _result(sensor: SelfSensor, case: Case, motion: Levitation, seed: int) -> Result:
    pwm = sensor.supply.frequency
    current, switching, _, _ = _sensed(sensor, case, motion, AVERAGED * pwm, seed)
    signals = averaged_signals(current, switching, sensor.supply.voltage, AVERAGED * pwm, pwm)
    _, _, own_time, estimator = _sensed(sensor, case, motion, sensor.acquisition.rate, seed)
    observed, _ = observe(
        design_observer(case.believed, pwm, poles_of(case.believed, pwm)), signals.voltage, signals.current
    )
    noise = _noise(case.believed)
    filtered, deviation = run(case.believed, signals.voltage, signals.current, pwm, *noise)
    wave = _wave(motion, pwm)
    position = wave(signals.time)
    readings = {
        "observer": (position, observed),
        "kalman": (position, filtered),
        "estimator": (wave(own_time), estimator),
    }
    return Result(
        case,
        signals.time,
        position,
        observed,
        filtered,
        own_time,
        estimator,
        motion=_late_rms(position),
        errors={name: _late_rms(reading - truth) for name, (truth, reading) in readings.items()},
        fitted={name: _fitted(truth, reading) for name, (truth, reading) in readings.items()},
        claim=float(deviation[-1]),
    )


def _sensed(
    sensor: SelfSensor, case: Case, motion: Levitation, rate: float, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Current (A), switching, time (s) and estimated displacement (m) of a case's coil at a rate (Hz), (samples,)."""
    pwm = sensor.supply.frequency
    supply = replace(sensor.supply, voltage=case.voltage)
    own = replace(sensor, coil=case.coil, supply=supply, acquisition=replace(sensor.acquisition, rate=rate))
    samples = int((motion.displacement.size - 1) / pwm * rate)
    time = np.arange(1, samples + 1) / rate
    drive = (motion.voltage / case.voltage)[np.floor(np.arange(samples) * (pwm / rate) + 1e-9).astype(int)]
    sensed = simulate([own], own.gap - _wave(motion, pwm)(time), drive, seed=seed)
    return sensed.current[0], sensed.switching[0], time, own.gap - sensed.estimate[0]


def _wave(motion: Levitation, pwm: float) -> "scipy.interpolate.CubicHermiteSpline":
    return scipy.interpolate.CubicHermiteSpline(
        np.arange(motion.displacement.size) / pwm, motion.displacement, motion.velocity
    )


def _late_rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values[values.size // 2 :] ** 2)))


def _fitted(truth: np.ndarray, reading: np.ndarray) -> float:
    """Rms error of the second half after the offset and gain of the reading that make it least."""
    late = slice(truth.size // 2, None)
    design = np.stack([reading[late], np.ones(truth[late].size)], axis=1)
    return float(np.std(truth[late] - design @ np.linalg.lstsq(design, truth[late])[0]))
