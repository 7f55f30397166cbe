"""The linearised nominal loop's exact sampled-data frequency responses: what a noise-free small experiment measures."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

from estimation.periods import LineStatistics
from maglev_env.effects import effect_value, split_delay
from maglev_env.experiment import Experiment
from maglev_env.magnetics import force_law, linearise


@dataclass(frozen=True)
class LoopResponse:
    """Responses at frequencies (n,) Hz, complex (n,), of the sampled loop.

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
    """Exact zero-order-hold discretisation of the experiment's linearised rig and effects, closed by its gains."""
    rig, gains = experiment.rig, experiment.gains
    dt = 1 / rig.control_rate
    z = np.exp(2j * np.pi * np.asarray(frequency, dtype=float) * dt)
    a_d, a_i = np.exp(-dt / gains.td), np.exp(-dt / gains.ti)
    controller = gains.kp + gains.kd / gains.td * (z - 1) / (z - a_d) + gains.ki * (1 - a_i) / (z - a_i)
    a, b_force, b_old, b_new, c = discrete_plant(experiment, dt)
    resolvent = np.linalg.inv(z[:, None, None] * np.eye(len(a)) - a)
    probe = 1 + effect_value(experiment.effects, "sensor_gain")
    whole, _ = split_delay(experiment.effects, dt)
    command = z[:, None] ** float(-whole) * (b_new + z[:, None] ** -1 * b_old)
    plant = probe * np.einsum("i,nij,nj->n", c, resolvent, command)
    open_receptance = probe * np.einsum("i,nij,j->n", c, resolvent, b_force)
    loop = controller * plant
    sensitivity = 1 / (1 + loop)
    receptance = open_receptance * sensitivity
    return LoopResponse(
        np.asarray(frequency), controller, plant, receptance, -controller * receptance, loop, sensitivity
    )


def closed_loop_poles(experiment: Experiment) -> np.ndarray:
    """Poles (z-plane) of the linearised sampled loop; stable when all lie inside the unit circle."""
    rig, gains = experiment.rig, experiment.gains
    dt = 1 / rig.control_rate
    a_d, a_i = np.exp(-dt / gains.td), np.exp(-dt / gains.ti)
    a, _, b_old, b_new, c = discrete_plant(experiment, dt)
    n = len(a)
    c = c * (1 + effect_value(experiment.effects, "sensor_gain"))
    delay, _ = split_delay(experiment.effects, dt)
    # States: plant, d, x, then the last delay + 1 commands, newest first.
    size = n + 2 + delay + 1
    m = np.zeros((size, size))
    m[:n, :n] = a
    error = np.zeros(size)
    error[:n] = -c
    command = (gains.kp + gains.kd / gains.td) * error
    command[n] -= gains.kd / gains.td
    command[n + 1] += gains.ki
    m[n] = (1 - a_d) * error
    m[n, n] += a_d
    m[n + 1] = (1 - a_i) * error
    m[n + 1, n + 1] += a_i
    commands = [command, *np.eye(size)[n + 2 :]]
    m[:n] += np.outer(b_new, commands[delay]) + np.outer(b_old, commands[delay + 1])
    for j in range(delay + 1):
        m[n + 2 + j] = commands[j]
    return np.linalg.eigvals(m)


def expected_statistics(experiment: Experiment, lines: np.ndarray) -> LineStatistics:
    """Noise-free line means of the linearised experiment, with the covariance that its noise would give them."""
    frequency = np.asarray(lines) * experiment.fundamental
    response = loop_response(experiment, frequency)
    rig, n = experiment.rig, experiment.samples_per_period

    def drive(at: str) -> np.ndarray:
        return np.fft.rfft(experiment.waveform(at))[lines] * (2 / n)

    force, injection, reference = drive("force"), drive("current"), drive("reference")
    s = response.sensitivity
    entry = injection + response.controller * reference
    displacement = response.receptance * force + response.plant * s * entry
    command = response.force_to_command * force + s * entry
    mean = np.array([displacement, command, force, injection])
    lsb = 2 * rig.voltage_range / 2**rig.adc_bits / rig.probe_gain if rig.adc_bits else 0.0
    noise = 4 / (n * experiment.periods)
    reading = np.array([s, -response.controller * s, 0 * s, 0 * s])
    covariance = reading[:, None] * np.conj(reading[None]) * (rig.noise.displacement**2 + lsb**2 / 12) * noise
    covariance[2, 2] += rig.noise.force**2 * noise
    channels = ("displacement", "command", "force", "injection")
    return LineStatistics(frequency, np.asarray(lines), channels, mean, covariance, experiment.periods)


def discrete_plant(e: Experiment, dt: float) -> tuple[np.ndarray, ...]:
    """A, B_force, B_old, B_new, C over one control sample; the command changes from old to new inside it."""
    rig, effects = e.rig, e.effects
    gain = stiffness = 0.0
    if rig.magnet != "none":
        gain, stiffness = linearise(force_law(rig))
        gain *= 1 + effect_value(effects, "actuator_gain")
        stiffness *= 1 + effect_value(effects, "negative_stiffness")
    mass = rig.mass * (1 + effect_value(effects, "mass"))
    k = rig.support_stiffness * (1 + effect_value(effects, "support_stiffness")) + stiffness
    c = rig.support_damping + effect_value(effects, "damping")
    amplifier = [t for t in (rig.amplifier_time_constant, effect_value(effects, "amplifier_lag")) if t > 0]
    sensor = [t for t in (rig.sensor_time_constant, effect_value(effects, "sensor_lag")) if t > 0]
    # States: y, v, amplifier poles, sensor poles; inputs: force, command.
    n = 2 + len(amplifier) + len(sensor)
    m = np.zeros((n + 2, n + 2))
    force_input, command_input = n, n + 1
    m[0, 1] = 1.0
    m[1, 0], m[1, 1], m[1, force_input] = -k / mass, -c / mass, 1 / mass
    source = command_input
    for j, t in enumerate(amplifier):
        m[2 + j, 2 + j], m[2 + j, source] = -1 / t, 1 / t
        source = 2 + j
    m[1, source] += gain / mass
    seen = 0
    for j, t in enumerate(sensor):
        row = 2 + len(amplifier) + j
        m[row, row], m[row, seen] = -1 / t, 1 / t
        seen = row
    _, switch = split_delay(effects, dt)
    first, second, whole = expm(m * switch), expm(m * (dt - switch)), expm(m * dt)
    b_old = second[:n, :n] @ first[:n, command_input]
    c_row = np.zeros(n)
    c_row[seen] = 1.0
    return whole[:n, :n], whole[:n, force_input], b_old, second[:n, command_input], c_row


def without_noise(experiment: Experiment) -> Experiment:
    """The experiment on ideal converters and noiseless channels: what remains is the deterministic rig."""
    quiet = replace(experiment.rig.noise, displacement=0.0, force=0.0, current=0.0)
    return replace(experiment, rig=replace(experiment.rig, noise=quiet, adc_bits=0, dac_bits=0))
