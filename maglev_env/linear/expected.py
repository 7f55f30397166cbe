"""What the lines of an experiment would be, by its linearised loop."""

import numpy as np

from estimation.lines.periods import LineStatistics
from maglev_env.channels import SPECTRAL
from maglev_env.experiment import Experiment, channels_of
from maglev_env.linear.loop import loop_response
from maglev_env.rig.rig import Rig, axis_rig


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
    power = np.array([reading_noise(axis_rig(rig, axis)) ** 2 for axis in range(axes)])
    power = power if experiment.sensor == "probe" else 0.0 * power
    noise = 4 / (n * experiment.periods)
    # Noise of the reading passes through the loop: the reading has (1 + P C)^-1 times it, the command -C times that.
    reading = np.linalg.inv(np.eye(axes) + plant @ controller)
    ways = np.concatenate([reading, -controller @ reading, np.zeros((len(reading), 2 * axes, axes))], axis=1)
    covariance = np.einsum("nia,a,nja->ijn", ways, power, ways.conj()) * noise
    for axis in range(2 * axes, 3 * axes):
        covariance[axis, axis] += rig.noise.force**2 * noise
    channels = channels_of(rig, SPECTRAL)
    return LineStatistics(frequency, np.asarray(lines), channels, mean, covariance, experiment.periods)


def reading_noise(rig: Rig) -> float:
    """Rms of the noise of the reading of one axis, m: the probe's own, and the rounding of its converter."""
    return float(np.hypot(rig.noise.displacement, rig.reading_step / np.sqrt(12)))
