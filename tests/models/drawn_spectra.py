"""Records drawn as spectra: the means and covariances that periods of Gaussian noise around known spectra give."""

from dataclasses import replace

import numpy as np

from estimation.lines.periods import LineStatistics
from maglev_env.evaluation.known_chain import force_statistics
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.linear.expected import expected_statistics
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import axis_rig
from maglev_env.rig.rig_file import load_rig


def draw(expected: LineStatistics, records: int, seed: int) -> LineStatistics:
    """`records` lanes around `expected` (no lanes), by numpy's own mean and sample covariance over periods."""
    rng, periods = np.random.default_rng(seed), expected.periods
    values, vectors = np.linalg.eigh(np.moveaxis(expected.covariance, -1, 0) * periods)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    shape = (records, periods, *root.shape[:2])
    white = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
    noise = np.einsum("nij,rpnj->rpin", root, white)
    mean = noise.mean(axis=1)
    rest = noise - mean[:, None]
    covariance = np.einsum("rpin,rpjn->rijn", rest, np.conj(rest)) / (periods - 1) / periods
    return replace(expected, mean=expected.mean + mean, covariance=covariance)


def record(statistics: LineStatistics, index: int) -> LineStatistics:
    return replace(statistics, mean=statistics.mean[index], covariance=statistics.covariance[index])


def within(statistics: LineStatistics, low: float, high: float) -> LineStatistics:
    inside = (statistics.frequency > low - 1e-6) & (statistics.frequency < high + 1e-6)
    return statistics.at_lines(statistics.lines[inside])


def rig_experiment(name: str) -> Experiment:
    """The rig's protocol; the pedestal's extended to 250 Hz, loud enough to be informative there."""
    experiment = protocol_experiment(axis_rig(load_rig(name), 0))
    if name == "pedestal":
        (force,) = experiment.excitations
        experiment = replace(experiment, excitations=(replace(force, lines=tuple(range(1, 501)), amplitude=5.0),))
    return experiment


def expected_force_statistics(experiment: Experiment) -> LineStatistics:
    """What a noise-free small experiment would measure at its force lines, with the covariance of its noise."""
    lines = lines_at(experiment.excitations, "force")
    statistics = force_statistics(expected_statistics(experiment, lines), experiment)
    keep = [statistics.index(channel) for channel in ("displacement", "force")]
    return replace(
        statistics,
        channels=("displacement", "force"),
        mean=statistics.mean[keep],
        covariance=statistics.covariance[np.ix_(keep, keep)],
    )


def two_channels(frequency, force, displacement, covariance, periods=5) -> LineStatistics:
    """LineStatistics of (displacement, force); covariance of the means (2, 2) or (2, 2, n) in that order."""
    covariance = np.asarray(covariance, dtype=complex)
    if covariance.ndim == 2:
        covariance = np.repeat(covariance[:, :, None], len(frequency), axis=2)
    mean = np.array([displacement, force], dtype=complex)
    lines = np.round(frequency).astype(int)
    return LineStatistics(np.asarray(frequency, float), lines, ("displacement", "force"), mean, covariance, periods)
