"""The scatter that lost commands must make in recordings without a period, against the noise that these have.

On average a loop that repeats the last command is one that comes late, and so it is simulated. What tells it from a
delay is its scatter: which commands are lost is chance. With a(k) what the amplifier gets, u(k) the command and p the
probability of a loss, a(k) is p a(k-1) + (1 - p) u(k) and white noise of the variance p (1 - p) E(u(k) - a(k-1))^2. The
variance of a itself is p times the mean square of u(k) - E a(k-1), and adds to this.
"""

import numpy as np
import scipy.signal

from estimation.lines.line_windows import KEPT, POOLED
from sim2real.compared.commands_seen import LOST
from sim2real.compared.problem import Part, Problem
from sim2real.recorded.open_record import OpenRecord
from sim2real.search.fit import NOT_TOLD, Fit

RINGS = 2.0  # times the responses of the windows beside it that of a window in which a plant rings has
AWAY = (0.0, -1.0, 1.0, -2.0, 2.0)  # standard errors from the fitted probability at which the scatter is asked
PARTS = (0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 2.0, 4.0)  # of the fitted probability likewise, where no fit tells it
DRAWS = 64  # of the scatter, whose mean powers tell where it is


def scatter_cost(problem: Problem, fit: Fit) -> float:
    """-2 ln of the likelihood ratio of what lost commands leave of recordings without a period, under the scatter that
    they must make where that exceeds the noise as it was told.

    It is a cost where the noise was told from what is left, which then is too small. Where other recordings bound it,
    what is left beyond it may be just this scatter. How many are lost, the scatter tells together with the fit.

    Args:
        problem: The recordings.
        fit: A hypothesis; 0 without lost commands in it.
    """
    at = [i for i, c in enumerate(fit.hypothesis.coordinates) if c.effect == LOST]
    if not at or not np.isfinite(fit.residual).all():
        return 0.0
    own, spread = fit.hypothesis.coordinates[at[0]], 0.0 if fit.jacobian is None else fit.spread[at[0]]
    fitted = float(fit.u[at[0]])
    if spread >= NOT_TOLD:  # beside a lag, which may be any part of what is late
        shares = [(own.value(part * fitted), 0.0) for part in PARTS]
    else:
        shares = [(own.value(fitted + sd * spread), sd**2) for sd in (AWAY if spread else (0.0,))]
    return min(scatter_cost_of(problem, lost, fit.residual) + off for lost, off in shares)


def scatter_cost_of(problem: Problem, lost: float, residual: np.ndarray) -> float:
    """As `scatter_cost`, of lost commands with a probability `lost` that leave a whitened residual (K,)."""
    if lost <= 0:
        return 0.0
    cost = 0.0
    for part in problem.parts:
        record = part.record
        if isinstance(record, OpenRecord) and scatters(record):
            ratio = np.where(_rings(part.opened.plant), 1.0, scatter_ratio(part, record, lost))[:, part.used]
            excess = np.maximum(ratio, 1.0)
            whole = residual[part.place].reshape(*part.measured.shape[:2], -1)
            left = abs(whole[part.opened.outputs.index("plant")]) ** 2
            own = float(np.sum(2.0 * np.log(excess) + left * (1 / excess - 1)))
            # Noise that is told from POOLED windows is too small for it by chance in every other one.
            by_chance = left.size / (2 * POOLED * KEPT)
            cost += own if own < 0 else max(own - by_chance, 0.0)
    return cost


def _rings(plant: np.ndarray) -> np.ndarray:
    """Whether the plant (axes, n) rings within a window, and not beside it: what is left there of its noise, beside
    what rings on at both ends of a record, is not that of the middle of the window."""
    size = abs(plant).reshape(len(plant), -1, KEPT).mean(axis=-1)
    beside = np.pad(size, ((0, 0), (1, 1)), mode="edge")
    peak = size > RINGS * np.sqrt(beside[:, :-2] * beside[:, 2:])
    return np.repeat(peak, KEPT, axis=-1)


def scatters(record: OpenRecord) -> bool:
    """Whether what a record drives passes through the commands that may be lost, all of which were recorded."""
    return LOST not in record.upstream and record.every == 1


def scatter_ratio(part: Part, record: OpenRecord, lost: float) -> np.ndarray:
    """Variance of the opened displacement by lost commands over that of its noise, (axes, n).

    Args:
        part: The record's share of the problem.
        record: Its record, whose control samples were all recorded.
        lost: Probability of a loss, below 1.
    """
    w = record.windows
    variance = scatter_variance(record.command[:, record.first : record.first + w.samples], lost)
    delayed = np.exp(-2j * np.pi * record.frequency / w.sample_rate)
    moved = abs(part.opened.plant / (1 - lost * delayed)) ** 2 * variance[:, None] * 4 / w.samples
    return moved / part.noise[part.opened.outputs.index("plant")] ** 2


def scatter_variance(command: np.ndarray, lost: float) -> np.ndarray:
    """Variance (axes,) of the white noise that lost commands (axes, samples) add at each sample, A^2.

    Args:
        command: What the controller asks for, A.
        lost: Probability of a loss, below 1.
    """
    return lost * (1 - lost**2) * np.mean(_unlike_the_last(command, lost)[:, 1:] ** 2, axis=-1)


def _unlike_the_last(command: np.ndarray, lost: float) -> np.ndarray:
    """By how much each command differs from what the amplifier got before on average, (axes, samples)."""
    passed, _ = scipy.signal.lfilter([1 - lost], [1, -lost], command, axis=-1, zi=lost * command[:, :1])
    return command - np.concatenate([command[:, :1], passed[:, :-1]], axis=-1)


def louder_along(part: Part, record: OpenRecord, lost: float) -> np.ndarray:
    """Power per direction of the excitation over that in all others, (axes, windows), that lost commands make.

    The scatter is there while the command moves. Along a chirp, each window is the moment at which the chirp passed its
    frequency, and the noise of that moment; the other directions hold that of the whole record.

    Args:
        part: The record's share of the problem.
        record: Its record, whose control samples were all recorded.
        lost: Probability of a loss, below 1.
    """
    w = record.windows
    scatter = _unlike_the_last(record.command[:, record.first : record.first + w.samples], lost)
    drawn = np.random.default_rng(0).standard_normal((DRAWS, *scatter.shape)) * scatter
    noise = w.noise(w.spectrum(drawn), record.drives)
    louder = noise.explained.mean(axis=0) / np.maximum(noise.rank, 1) / np.maximum(noise.variance.mean(axis=0), 1e-300)
    share = scatter_ratio(part, record, lost).reshape(*louder.shape, -1).mean(axis=-1)
    return np.where(noise.rank > 0, 1 + np.minimum(share, 1.0) * (louder - 1), 1.0)  # nothing drives some windows
