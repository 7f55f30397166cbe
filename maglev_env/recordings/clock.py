"""A recorder whose clock is not that of the excitation: how fast it is, and the recording by the excitation's clock."""

from collections.abc import Sequence

import numpy as np
import scipy

from estimation.lines.periods import LEAST, period_drift, period_spectra, split_periods
from maglev_env.channels import SHOWN_BY
from maglev_env.rig.excitation import Excitation

CLEAR = 8.0  # standard errors from which a drift of the periods is another clock
TURNED = 0.1  # rad by which it must turn the highest line over the recording to take lines away
PASSES = 2  # the first leaves what leaks between the lines
APART = 0.05  # samples over the recording by which channels of one clock may seem to drift apart
SAMPLES = 8  # per cycle of the highest line, from which a cubic spline between samples is off by less than 0.1 %


def corrected(
    stack: np.ndarray, names: Sequence[str], excitations: Sequence[Excitation], block: tuple[int, int]
) -> tuple[np.ndarray, float]:
    """Channels as a recorder with the excitation's clock would have read them, and the share by which its own is fast.

    The channels that drive tell it. Where they do not, or another channel still drifts afterwards and so came by
    another recorder, the channels are returned as they are, with 0.

    Args:
        stack: Channels (channels, samples).
        names: Their names.
        excitations: Periodic ones of the recording.
        block: Samples that they repeat after, and the number of their periods in these.
    """
    samples, every = block
    count, fast, now = stack.shape[1] // samples, 0.0, stack
    if count < LEAST:
        return stack, 0.0
    for _ in range(PASSES):
        told = [found for e in excitations if (found := _driven(now, names, e, block))]
        if not told:
            return stack, 0.0
        ahead, error, highest = min(told, key=lambda found: found[1])
        if not fast and not (abs(ahead) > CLEAR * error and abs(ahead) * count * highest > TURNED):
            return stack, 0.0
        fast -= ahead / samples
        now = by_excitation(stack, fast, samples)
    for e in excitations:
        found = _drift(now, np.array(e.lines) * every, samples)
        if any(one and abs(one[0]) > CLEAR * one[1] + APART / count for one in found):
            return stack, 0.0
    return now, fast


def by_excitation(stack: np.ndarray, fast: float, samples: int) -> np.ndarray:
    """Channels (channels, samples) of a clock that was fast by a share, by that of the excitation.

    A fast clock has read too little for the last period: the samples begin as much later, for all channels alike.

    Args:
        stack: Channels (channels, samples).
        fast: Share by which the clock was fast.
        samples: That the excitation repeats after.
    """
    last = stack.shape[1] - 1
    ticks = np.arange(int(last * (1 - fast)) + 1) / (1 - fast)
    rest = len(ticks) % samples if fast > 0 else 0
    return np.asarray(scipy.interpolate.CubicSpline(np.arange(last + 1), stack, axis=1)(ticks[rest:]))


def _driven(
    stack: np.ndarray, names: Sequence[str], e: Excitation, block: tuple[int, int]
) -> tuple[float, float, float] | None:
    """Drift of the channel that an excitation drives most, its error, and the highest line in radians per sample."""
    own = [i for i, name in enumerate(names) if name.partition("_")[0] == SHOWN_BY[e.at]]
    if not own:
        return None
    loud = stack[max(own, key=lambda i: float(np.var(stack[i])))]
    (found,) = _drift(loud[None], np.array(e.lines) * block[1], block[0])
    return found and (*found, 2 * np.pi * max(e.lines) * block[1] / block[0])


def _drift(stack: np.ndarray, lines: np.ndarray, samples: int) -> list[tuple[float, float] | None]:
    """`period_drift` of every channel at lines of a block."""
    spectra = np.array([period_spectra(p, lines) for p in split_periods(stack, samples)])
    spectra = spectra[1 if len(spectra) > LEAST else 0 :]  # the first period may contain the start
    return [period_drift(one, 2 * np.pi * lines / samples) for one in spectra.swapaxes(0, 1)]
