"""The linearised nominal loop's exact sampled-data frequency responses: what a noise-free small experiment measures."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

from estimation.periods import LineStatistics
from maglev_env.effects import effect_value, split_delay
from maglev_env.experiment import SPECTRAL, Experiment, axis_experiment, channels_of, moving_mass, self_sensors
from maglev_env.gains import controller_response, of_axis, state_space
from maglev_env.magnetics import force_law, linearise
from maglev_env.planar import NO_CROSS
from maglev_env.rig import axis_rig
from selfsense.baseband import baseband, growth_rate


@dataclass(frozen=True)
class LoopResponse:
    """Responses of the sampled loop at frequencies (n,) Hz: complex (n,), or (n, 2, 2) on an x-y rig, [to, from] axis.

    controller (A/m) from error to command; plant (m/A) from command to displacement reading; receptance (m/N) from
    the held force to the reading and force_to_command (A/N) in closed loop; loop_gain = controller * plant;
    sensitivity = 1 / (1 + loop_gain), also the response command / injection.
    """

    frequency: np.ndarray
    controller: np.ndarray
    plant: np.ndarray
    receptance: np.ndarray
    force_to_command: np.ndarray
    loop_gain: np.ndarray
    sensitivity: np.ndarray


def loop_response(experiment: Experiment, frequency: np.ndarray) -> LoopResponse:
    """Exact zero-order-hold discretisation of the linearised rig with its effects, closed by its controllers."""
    axes, dt = experiment.rig.axes, 1 / experiment.rig.control_rate
    z = np.exp(2j * np.pi * np.asarray(frequency, dtype=float) * dt)
    controller = np.zeros((len(z), axes, axes), complex)
    for axis in range(axes):
        controller[:, axis, axis] = controller_response(of_axis(experiment.gains, axis), z, dt)
    a, b_force, b_old, b_new, c = discrete_plant(experiment)
    from_plant = c @ np.linalg.inv(z[:, None, None] * np.eye(len(a)) - a)
    whole, _ = split_delay(experiment.effects, dt)
    plant = z[:, None, None] ** float(-whole) * (from_plant @ b_new + (from_plant @ b_old) / z[:, None, None])
    loop = controller @ plant
    sensitivity = np.linalg.inv(np.eye(axes) + loop)
    receptance = np.linalg.inv(np.eye(axes) + plant @ controller) @ from_plant @ b_force
    found = (controller, plant, receptance, -controller @ receptance, loop, sensitivity)
    return LoopResponse(np.asarray(frequency), *(m[:, 0, 0] if axes == 1 else m for m in found))


def closed_loop_poles(experiment: Experiment) -> np.ndarray:
    """Poles (z-plane) of the linearised sampled loop; stable when all lie inside the unit circle.

    With self-sensing those of its baseband model, and for an estimator that is unstable by itself its growth.
    """
    poles = np.linalg.eigvals(closed_loop(experiment)[0])
    growth = np.array([growth_rate(sensor) for sensor in self_sensors(experiment)])
    return np.concatenate([poles, np.exp(growth[growth >= 0] / experiment.rig.control_rate)])


def closed_loop(experiment: Experiment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C of the linearised sampled loop from the held force of each axis (N) to its displacement reading (m)."""
    dt = 1 / experiment.rig.control_rate
    a, b_force, b_old, b_new, c = discrete_plant(experiment)
    delay, _ = split_delay(experiment.effects, dt)
    n, axes = len(a), len(c)
    controllers = [state_space(of_axis(experiment.gains, axis), dt) for axis in range(axes)]
    # States: plant, controllers, then the last delay + 1 commands of every axis, newest first.
    held = n + sum(len(k[1]) for k in controllers)
    size = held + (delay + 1) * axes
    m = np.zeros((size, size))
    m[:n, :n] = a
    command = np.zeros((axes, size))
    first = n
    for axis, (ka, kb, kc, kd) in enumerate(controllers):
        own = slice(first, first + len(kb))
        m[own, own], m[own, :n] = ka, -np.outer(kb, c[axis])
        command[axis, own], command[axis, :n] = kc, -kd * c[axis]
        first = own.stop
    stored = np.eye(size)[held:]
    commands = np.concatenate([command, stored])  # now, one sample ago, ...
    m[:n] += b_new @ commands[delay * axes : (delay + 1) * axes] + b_old @ commands[(delay + 1) * axes :][:axes]
    m[held:] = commands[: (delay + 1) * axes]
    return m, np.pad(b_force, ((0, size - n), (0, 0))), np.pad(c, ((0, 0), (0, size - n)))


def expected_statistics(experiment: Experiment, lines: np.ndarray) -> LineStatistics:
    """Noise-free line means of the linearised experiment, with the covariance that its noise would give them.

    The noise of self-sensing's estimate is left out.
    """
    frequency = np.asarray(lines) * experiment.fundamental
    response = loop_response(experiment, frequency)
    rig, n, axes = experiment.rig, experiment.samples_per_period, experiment.rig.axes
    receptance, plant, s, controller, to_command = (
        m.reshape(-1, axes, axes)
        for m in (
            response.receptance, response.plant, response.sensitivity, response.controller, response.force_to_command
        )
    )  # fmt: skip

    def drive(at: str) -> np.ndarray:
        return np.fft.rfft(np.atleast_2d(experiment.waveform(at)), axis=-1)[:, lines].T[..., None] * (2 / n)

    force, injection, reference = drive("force"), drive("current"), drive("reference")
    command = to_command @ force + s @ (injection + controller @ reference)
    displacement = receptance @ force + plant @ s @ (injection + controller @ reference)
    mean = np.concatenate([displacement, command, force, injection], axis=1)[..., 0].T
    # Resolution of each axis' converter, as white noise beside the probe's own.
    own = [axis_rig(rig, axis) for axis in range(axes)]
    lsb = np.array([2 * r.voltage_range / 2**r.adc_bits / r.probe_gain if r.adc_bits else 0.0 for r in own])
    power = rig.noise.displacement**2 + lsb**2 / 12 if experiment.sensor == "probe" else 0.0 * lsb
    noise = 4 / (n * experiment.periods)
    # Reading noise runs around the loop: the reading is (1 + P C)^-1 of it, the command -C times that.
    reading = np.linalg.inv(np.eye(axes) + plant @ controller)
    ways = np.concatenate([reading, -controller @ reading, np.zeros((len(reading), 2 * axes, axes))], axis=1)
    covariance = np.einsum("nia,a,nja->ijn", ways, power, ways.conj()) * noise
    for axis in range(2 * axes, 3 * axes):
        covariance[axis, axis] += rig.noise.force**2 * noise
    channels = channels_of(rig, SPECTRAL)
    return LineStatistics(frequency, np.asarray(lines), channels, mean, covariance, experiment.periods)


def discrete_plant(experiment: Experiment) -> tuple[np.ndarray, ...]:
    """A (n, n), B_force, B_old, B_new (n, axes), C (axes, n) over one control sample, from held forces and commands to
    displacement readings; each command changes from old to new inside the sample when a delay has a fraction."""
    rig, axes = experiment.rig, experiment.rig.axes
    dt = 1 / rig.control_rate
    parts = [_continuous(axis_experiment(experiment, axis)) for axis in range(axes)]
    sizes = [len(part[0]) for part in parts]
    starts = np.cumsum([0, *sizes])
    n = int(starts[-1])
    m = np.zeros((n + 2 * axes, n + 2 * axes))
    c = np.zeros((axes, n))
    for axis, (a, b, reading, _) in enumerate(parts):
        own = slice(starts[axis], starts[axis + 1])
        m[own, own], m[own, n + axis], m[own, n + axes + axis] = a, b[:, 0], b[:, 1]
        c[axis, own] = reading
    if rig.cross != NO_CROSS:
        for axis, other in ((0, 1), (1, 0)):
            stiffness, damping, gain, sensor = rig.cross.onto(axis)
            mass = moving_mass(axis_experiment(experiment, axis))
            row, first = starts[axis] + 1, starts[other]
            m[row, first] -= stiffness / mass
            m[row, first + 1] -= damping / mass
            source = parts[other][3]
            m[row, n + axes + other if source is None else first + source] += gain / mass
            c[axis, first : starts[other + 1]] += sensor * parts[other][2]
    c *= 1 + effect_value(experiment.effects, "sensor_gain")
    _, switch = split_delay(experiment.effects, dt)
    first, second = expm(m * switch) if switch else np.eye(len(m)), expm(m * (dt - switch))
    whole = second @ first
    b_old = second[:n, :n] @ first[:n, n + axes :]
    return whole[:n, :n], whole[:n, n : n + axes], b_old, second[:n, n + axes :], c


def _continuous(e: Experiment) -> tuple[np.ndarray, np.ndarray, np.ndarray, int | None]:
    """A, B (force, command), C of one axis in continuous time, and which state is its current (None: the command)."""
    rig, effects = e.rig, e.effects
    gain = stiffness = 0.0
    if rig.controlled:
        gain, stiffness = linearise(force_law(rig))
        gain *= 1 + effect_value(effects, "actuator_gain")
        stiffness *= 1 + effect_value(effects, "negative_stiffness")
    mass = moving_mass(e)
    k = rig.support_stiffness * (1 + effect_value(effects, "support_stiffness")) + stiffness
    c = rig.support_damping + effect_value(effects, "damping")
    amplifier = [t for t in (rig.amplifier_time_constant, effect_value(effects, "amplifier_lag")) if t > 0]
    sensor_a, sensor_b, sensor_c = _sensor(e)
    # States: y, v, amplifier poles, sensor.
    first = 2 + len(amplifier)
    n = first + len(sensor_b)
    a, b, seen = np.zeros((n, n)), np.zeros((n, 2)), np.zeros(n)
    a[0, 1] = 1.0
    a[1, 0], a[1, 1], b[1, 0] = -k / mass, -c / mass, 1 / mass
    for j, t in enumerate(amplifier):
        a[2 + j, 2 + j] = -1 / t
        if j:
            a[2 + j, 1 + j] = 1 / t
        else:
            b[2, 1] = 1 / t
    current = 1 + len(amplifier) if amplifier else None
    if amplifier:
        a[1, current] = gain / mass
    else:
        b[1, 1] = gain / mass
    a[first:, first:], a[first:, 0], seen[first:] = sensor_a, sensor_b, sensor_c
    if not len(sensor_b):
        seen[0] = 1.0
    return a, b, seen, current


def _sensor(e: Experiment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C from displacement to reading in continuous time; empty for a probe without lag."""
    if e.sensor != "probe":
        return baseband(self_sensors(e)[0])
    poles = [t for t in (e.rig.sensor_time_constant, effect_value(e.effects, "sensor_lag")) if t > 0]
    n = len(poles)
    rates = 1 / np.array(poles)
    return np.diag(rates[1:], -1) - np.diag(rates), np.eye(n)[:1].sum(axis=0) * rates, np.eye(n)[-1:].sum(axis=0)


def without_noise(experiment: Experiment) -> Experiment:
    """The experiment on ideal converters and noiseless channels: what remains is the deterministic rig."""
    quiet = replace(experiment.rig.noise, displacement=0.0, force=0.0, current=0.0)
    sensing = replace(experiment.rig.self_sensing, adc_bits=0)
    rig = replace(experiment.rig, noise=quiet, adc_bits=0, dac_bits=0, self_sensing=sensing)
    sensor = experiment.sensor
    if isinstance(sensor, tuple):
        sensor = tuple(replace(s, acquisition=replace(s.acquisition, bits=0, noise=0.0)) for s in sensor)
    return replace(experiment, rig=rig, sensor=sensor)
