"""Exact sampled-data frequency responses of the linearised loop: the result of a small experiment without noise.

Effects enter with their linear part (see `linear_axis`), eddy currents with the same branches as in the simulator.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import scipy

from estimation.lines.periods import LineStatistics
from maglev_env.channels import SPECTRAL
from maglev_env.experiment import Experiment, axis_experiment, channels_of, moving_mass, self_sensors
from maglev_env.linear.axis import POSITION, VELOCITY, cross_terms, linear_axis
from maglev_env.loop.effect import effect_value, split_delay
from maglev_env.loop.gains import INPUTS, controller_response, of_axis, realised
from maglev_env.rig.rig import axis_rig
from selfsense.baseband import growth_rate


@dataclass(frozen=True)
class LoopResponse:
    """Responses of the sampled loop: complex (n,), or (n, 2, 2) on an x-y rig with indices [to, from] axis.

    Where the controller reads the coil's current, that loop is closed in all of them: the loop is broken at the
    reading.

    Args:
        frequency: (n,), Hz.
        controller: from the negative reading to the command, A/m; of a filter of the error from the error.
        plant: from command to displacement reading, m/A.
        receptance: from the held force to the reading in closed loop, m/N.
        force_to_command: from the held force to the command in closed loop, A/N.
        loop_gain: controller * plant.
        sensitivity: 1 / (1 + loop_gain), from an error of the reading to the reading; without a current that is read
            also the response command / injection.
        amplifier: from command to the coil's current at the control samples, A/A, including the delay. Without an
            amplifier pole it is the delay in samples, rounded up.
        from_reference: from the reference to the command with the loop open at the reading, A/m.
        from_injection: likewise from the injection, A/A; 1 if the current is not read.
    """

    frequency: np.ndarray
    controller: np.ndarray
    plant: np.ndarray
    receptance: np.ndarray
    force_to_command: np.ndarray
    loop_gain: np.ndarray
    sensitivity: np.ndarray
    amplifier: np.ndarray
    from_reference: np.ndarray
    from_injection: np.ndarray

    def __repr__(self) -> str:
        f = self.frequency
        return f"<LoopResponse at {f.size} frequencies, {f.min(initial=np.inf):g} to {f.max(initial=0.0):g} Hz>"


def loop_response(experiment: Experiment, frequency: np.ndarray) -> LoopResponse:
    """Responses of the linearised rig with its effects, exactly discretised and closed by its controllers.

    Args:
        experiment: with rig, effects, sensor and gains; its excitations are not used.
        frequency: (n,), Hz.
    """
    axes, dt = experiment.rig.axes, 1 / experiment.rig.control_rate
    z = np.exp(2j * np.pi * np.asarray(frequency, dtype=float) * dt)
    controls = np.zeros((len(INPUTS), len(z), axes, axes), complex)
    for (k, of), axis in product(enumerate(INPUTS), range(axes)):
        controls[k, :, axis, axis] = controller_response(of_axis(experiment.gains, axis), z, dt, of)
    m, c, current = _continuous(experiment)
    a, b_force, b_old, b_new = _discrete(experiment, m)
    n, (whole, fraction) = len(a), split_delay(experiment.effects, dt)
    from_states = _resolvent(a, np.concatenate([c, current[:, :n]]), z)
    late = z[:, None, None] ** float(-whole) * repeated(effect_value(experiment.effects, "dropped_samples"), z)
    from_command = late * (from_states @ b_new + (from_states @ b_old) / z[:, None, None])
    plant, amplifier = from_command[:, :axes], from_command[:, axes:]
    # Without an amplifier pole the current jumps with the command: at a sample it has its new value only if the delay
    # is a whole number of samples.
    amplifier = amplifier + current[:, n + axes :] * (late / z[:, None, None] if fraction else late)
    injected = np.linalg.inv(np.eye(axes) + controls[INPUTS.index("current")] @ amplifier)
    referred, controller = (injected @ controls[INPUTS.index(of)] for of in ("reference", "reading"))
    loop = controller @ plant
    sensitivity = np.linalg.inv(np.eye(axes) + loop)
    receptance = np.linalg.inv(np.eye(axes) + plant @ controller) @ from_states[:, :axes] @ b_force
    found = (
        controller, plant, receptance, -controller @ receptance, loop, sensitivity, amplifier, referred, injected
    )  # fmt: skip
    return LoopResponse(np.asarray(frequency), *(m[:, 0, 0] if axes == 1 else m for m in found))


def repeated(lost: float, z: np.ndarray) -> np.ndarray:
    """Expected response (n, 1, 1) at z (n,) from the command to what acts; the last one replaces those that are lost.

    Args:
        lost: probability with which a command is lost.
        z: e^(j w dt).
    """
    return ((1 - lost) / (1 - lost / z))[:, None, None]


def closed_loop_poles(experiment: Experiment, plant: tuple[np.ndarray, ...] | None = None) -> np.ndarray:
    """Poles (z-plane) of the linearised sampled loop, which is stable if all are inside the unit circle.

    With self-sensing the baseband model of the sensor is used; the growth of an estimator that is unstable by itself is
    added as a pole.

    Args:
        experiment: with rig, effects, sensor and gains.
        plant: its `discrete_plant`, if it has been computed already.

    Returns:
        Complex, (poles,).
    """
    poles = np.linalg.eigvals(closed_loop(experiment, plant)[0])
    return np.concatenate([poles, _growing(experiment)])


def pole_radii(experiments: Sequence[Experiment]) -> np.ndarray:
    """The largest magnitude (n,) of each experiment's `closed_loop_poles`."""
    # Together with all others that have the same plant, and controllers of the same order.
    alike: dict[tuple, list[int]] = {}
    realisations = [_realised(e) for e in experiments]
    for i, (e, own) in enumerate(zip(experiments, realisations, strict=True)):
        effects = tuple((name, *values.items()) for name, values in e.effects.items())
        alike.setdefault((id(e.rig), id(e.sensor), effects, *(len(part[2]) for part in own)), []).append(i)
    found = np.empty(len(experiments))
    for members in alike.values():
        first = experiments[members[0]]
        stacked = [
            tuple(map(np.array, zip(*parts, strict=True)))
            for parts in zip(*(realisations[i] for i in members), strict=True)
        ]
        loops = _closed(first, discrete_plant(first), stacked)[0]
        found[members] = np.abs(np.linalg.eigvals(loops)).max(axis=1)
        if growth := _growing(first):
            found[members] = np.maximum(found[members], max(growth))
    return found


def _realised(e: Experiment) -> list[tuple[np.ndarray, ...]]:
    """The controller of each axis, see `realised`."""
    return [realised(of_axis(e.gains, axis), 1 / e.rig.control_rate) for axis in range(e.rig.axes)]


def _growing(e: Experiment) -> list[float]:
    """Poles by the growth of self-sensing estimators that are unstable by themselves."""
    growth = (growth_rate(sensor) for sensor in self_sensors(e))
    return [float(np.exp(rate / e.rig.control_rate)) for rate in growth if rate >= 0]


def closed_loop(
    experiment: Experiment, plant: tuple[np.ndarray, ...] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The linearised sampled loop from the held force of each axis (N) to its displacement reading (m).

    Args:
        experiment: with rig, effects, sensor and gains.
        plant: its `discrete_plant`, if it has been computed already.

    Returns:
        State-space matrices A (s, s), B (s, axes) and C (axes, s).
    """
    controllers = [tuple(part[None] for part in own) for own in _realised(experiment)]
    loops, from_force, to_reading = _closed(experiment, plant or discrete_plant(experiment), controllers)
    return loops[0], from_force, to_reading


def _closed(
    experiment: Experiment, plant: tuple[np.ndarray, ...], controllers: Sequence[tuple[np.ndarray, ...]]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `closed_loop`, with A (n, s, s) of n controllers: of every axis, the stacked matrices of `realised`."""
    a, b_force, b_old, b_new, c, current = plant
    delay, _ = split_delay(experiment.effects, 1 / experiment.rig.control_rate)
    lost = effect_value(experiment.effects, "dropped_samples")
    n, axes, count = len(a), len(c), len(controllers[0][0])
    # States: plant, controllers, then the last delay + 1 commands of every axis, newest first.
    held = n + sum(k[2].shape[1] for k in controllers)
    size = held + (delay + 1) * axes
    m = np.zeros((count, size, size))
    m[:, :n, :n] = a
    command = np.zeros((count, axes, size))
    first = n
    for axis, (ka, kb, kc, kd) in enumerate(controllers):
        own = slice(first, first + kc.shape[1])
        read = -np.stack([c[axis], current[axis]])
        m[:, own, own], m[:, own, :n] = ka, kb[..., 1:] @ read
        command[:, axis, own], command[:, axis, :n] = kc, kd[:, 1:] @ read
        first = own.stop
    stored = np.eye(size)[held:]
    if lost:  # the expected command: in its place the one before it may act again
        command = (1 - lost) * command + lost * stored[:axes]
    # Commands now, one sample ago, ...
    commands = np.concatenate([command, np.broadcast_to(stored, (count, *stored.shape))], axis=1)
    m[:, :n] += b_new @ commands[:, delay * axes : (delay + 1) * axes]
    m[:, :n] += b_old @ commands[:, (delay + 1) * axes :][:, :axes]
    m[:, held:] = commands[:, : (delay + 1) * axes]
    from_force, to_reading = np.zeros((size, axes)), np.zeros((axes, size))
    from_force[:n], to_reading[:, :n] = b_force, c
    return m, from_force, to_reading


def expected_statistics(experiment: Experiment, lines: np.ndarray) -> LineStatistics:
    """Noise-free means of the linearised experiment at its lines, with the covariance that its noise would cause.

    The noise of a self-sensing estimate is left out, and so are runout, pickup and unbalance.

    Args:
        experiment: with periodic excitations.
        lines: (f,), harmonic numbers of the experiment's fundamental.
    """
    frequency = np.asarray(lines) * experiment.fundamental
    response = loop_response(experiment, frequency)
    rig, n, axes = experiment.rig, experiment.samples_per_period, experiment.rig.axes
    receptance, plant, s, controller, to_command, from_reference, from_injection = (
        m.reshape(-1, axes, axes)
        for m in (
            response.receptance, response.plant, response.sensitivity, response.controller, response.force_to_command,
            response.from_reference, response.from_injection,
        )
    )  # fmt: skip

    def drive(at: str) -> np.ndarray:
        return np.fft.rfft(np.atleast_2d(experiment.waveform(at)), axis=-1)[:, lines].T[..., None] * (2 / n)

    force, injection, reference = drive("force"), drive("current"), drive("reference")
    put_in = s @ (from_injection @ injection + from_reference @ reference)
    command, displacement = to_command @ force + put_in, receptance @ force + plant @ put_in
    mean = np.concatenate([displacement, command, force, injection], axis=1)[..., 0].T
    # The rounding of each axis' converter acts as white noise, in addition to the probe's own noise.
    own = [axis_rig(rig, axis) for axis in range(axes)]
    lsb = np.array([2 * r.voltage_range / 2**r.adc_bits / r.probe_gain if r.adc_bits else 0.0 for r in own])
    power = rig.noise.displacement**2 + lsb**2 / 12 if experiment.sensor == "probe" else 0.0 * lsb
    noise = 4 / (n * experiment.periods)
    # Noise of the reading passes through the loop: the reading has (1 + P C)^-1 times it, the command -C times that.
    reading = np.linalg.inv(np.eye(axes) + plant @ controller)
    ways = np.concatenate([reading, -controller @ reading, np.zeros((len(reading), 2 * axes, axes))], axis=1)
    covariance = np.einsum("nia,a,nja->ijn", ways, power, ways.conj()) * noise
    for axis in range(2 * axes, 3 * axes):
        covariance[axis, axis] += rig.noise.force**2 * noise
    channels = channels_of(rig, SPECTRAL)
    return LineStatistics(frequency, np.asarray(lines), channels, mean, covariance, experiment.periods)


def discrete_plant(experiment: Experiment) -> tuple[np.ndarray, ...]:
    """The plant over one control sample, from held forces (N) and commands (A) to displacement readings (m).

    With a delay that is not a whole number of samples, each command changes from old to new within the sample.

    Returns:
        A (n, n); B_force, B_old and B_new (n, axes) each; C (axes, n); and the coils' currents (axes, n) in A, without
        what jumps with the command.
    """
    m, c, current = _continuous(experiment)
    return *_discrete(experiment, m), c, current[:, : c.shape[1]]


def _discrete(experiment: Experiment, m: np.ndarray) -> tuple[np.ndarray, ...]:
    """A, B_force, B_old, B_new of `discrete_plant` from the rates m of states, held forces and held commands."""
    dt, axes = 1 / experiment.rig.control_rate, experiment.rig.axes
    n = len(m) - 2 * axes
    _, switch = split_delay(experiment.effects, dt)
    first, second = scipy.linalg.expm(m * switch) if switch else np.eye(len(m)), scipy.linalg.expm(m * (dt - switch))
    whole = second @ first
    b_old = second[:n, :n] @ first[:n, n + axes :]
    return whole[:n, :n], whole[:n, n : n + axes], b_old, second[:n, n + axes :]


def _resolvent(a: np.ndarray, rows: np.ndarray, z: np.ndarray) -> np.ndarray:
    """rows (z - A)^-1 at every z (f,), shape (f, rows, n).

    A Schur decomposition makes A triangular once, so that each frequency needs a back substitution only; unlike an
    eigendecomposition it is accurate for any A.
    """
    a, _, _, scale, _ = scipy.linalg.lapack.dgebal(
        a, scale=1
    )  # balancing: states of very different size would lose accuracy
    triangular, basis = scipy.linalg.schur(a, output="complex")
    wanted = (rows * scale) @ basis
    solved = np.empty((len(a), len(z), len(rows)), complex)
    for j in range(len(a)):
        before = np.einsum("i,ifr->fr", triangular[:j, j], solved[:j])
        solved[j] = (wanted[:, j] + before) / (z - triangular[j, j])[:, None]
    return np.moveaxis(solved, 0, 2) @ basis.conj().T / scale


def _continuous(experiment: Experiment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Linear equations of all axes in continuous time.

    Returns:
        Rates (n, n) of the states of all axes, then their held forces, then their held commands; readings
        (axes, states) in m; coil currents (axes, n) in A.
    """
    axes = experiment.rig.axes
    views = [axis_experiment(experiment, axis) for axis in range(axes)]
    parts = [linear_axis(view) for view in views]
    starts = np.cumsum([0, *(len(part.rates) - 2 for part in parts)])
    states = int(starts[-1])
    n = states + 2 * axes
    # Indices of each axis' states, force and command among those of all axes.
    own = [np.r_[starts[axis] : starts[axis + 1], states + axis, states + axes + axis] for axis in range(axes)]
    m, c, current = np.zeros((n, n)), np.zeros((axes, n)), np.zeros((axes, n))
    for axis, part in enumerate(parts):
        m[np.ix_(own[axis], own[axis])] = part.rates
        c[axis, own[axis]], current[axis, own[axis]] = part.reading, part.current
    for axis, other in ((0, 1), (1, 0)) if axes == 2 else ():
        stiffness, damping, gain, sensor = cross_terms(experiment, axis, views[other])
        pushed = np.zeros(n)
        pushed[own[other]] = gain * parts[other].pulling
        pushed[own[other][POSITION]] -= stiffness
        pushed[own[other][VELOCITY]] -= damping
        m[own[axis]] += np.outer(parts[axis].driven, pushed / moving_mass(views[axis]))
        c[axis, own[other]] += sensor * parts[other].reading
    return m, c[:, :states] * (1 + effect_value(experiment.effects, "sensor_gain")), current


def without_noise(experiment: Experiment) -> Experiment:
    """The experiment with ideal converters and without noise."""
    quiet = replace(experiment.rig.noise, displacement=0.0, force=0.0, current=0.0)
    sensing = replace(experiment.rig.self_sensing, adc_bits=0)
    rig = replace(experiment.rig, noise=quiet, adc_bits=0, dac_bits=0, self_sensing=sensing)
    sensor = experiment.sensor
    if isinstance(sensor, tuple):
        sensor = tuple(replace(s, acquisition=replace(s.acquisition, bits=0, noise=0.0)) for s in sensor)
    return replace(experiment, rig=rig, sensor=sensor)
