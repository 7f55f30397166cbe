"""A recorded channel against what others make of it: gain, sign and delay with their standard errors.

Each rule of this kind is one fit: out = sum of g_i exp(-j w d_i) in_i over spectral lines. Under the null hypothesis
all g_i are 1 and all d_i are 0, up to noise, whose variance is measured over periods or neighbouring lines, and up to
what is known of the nominal parts (the tolerance of a row). Estimates are then normal, by the many lines they average.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from estimation.lines.frequency_response import pooled_variance

REACH, STEP = 26.0, 0.5  # samples: delays that are searched, and the grid on which they are
FINE, FINEST = 25, 1e-3  # points of each of the finer grids, and the last one's width in steps of the first
MODEL = 0.01  # of a line's amplitude: what the nominal responses are trusted to
NEIGHBOURS = 9  # lines over which noise without periods is averaged
LEAST_LINES = 6
ONE_LINE = 3.0  # a sine fills two lines of a Hann window
KNOWN = 0.2  # relative standard error from which a gain says nothing
LEVEL = 4.5  # standard errors: two-sided 7e-6, so that some hundred tests of a campaign raise 0.1 % of false alarms


@dataclass(frozen=True)
class Fit:
    """Gains (k,), delays (k,) in s, their standard errors (relative ones of the gains), misfit, cost, and lines (k,).

    The misfit is relative; the cost is the weighted power that is left. Lines: how many hold what each input tells; of
    segments the squared sum of their shares over the sum of squares.
    """

    gain: np.ndarray
    delay: np.ndarray
    gain_se: np.ndarray
    delay_se: np.ndarray
    misfit: float
    cost: float
    lines: np.ndarray

    def time(self, i: int) -> float | None:
        """Delay of input i, s; None where its power is in one line: a delay and an error of phase look alike there."""
        return float(self.delay[i]) if self.lines[i] > ONE_LINE else None


@dataclass(frozen=True)
class Row:
    """One comparison.

    Attributes:
        code: The rule's name.
        powers: Channel or parameter -> +1 or -1: how a factor on it changes the gain; its delay counts alike.
        gain: 1 if all is well; negative for a reversed sign.
        gain_se: Its standard error, relative.
        tolerance: Of the gain's logarithm, from what is known of the nominal parts.
        against: What the channel is compared with, in words.
        delay: s; None where it cannot be told.
        delay_se: Its standard error.
        delay_tolerance: Likewise, s.
        misfit: What gain and delay do not explain, relative.
        most_misfit: How much of it is no sign of anything.
        gain_effects: Effects of the library that change the gain; empty: none does.
        delay_effects: Likewise of delay and misfit.
        lag: Time constant (s) of a low-pass that explains more than a delay: > 0 of the first channel of `powers`,
            < 0 of the second; 0: none.
        signed: Whether the sign of the gain is known.
    """

    code: str
    powers: Mapping[str, int]
    gain: float
    gain_se: float
    tolerance: float
    against: str
    delay: float | None = None
    delay_se: float = 0.0
    delay_tolerance: float = 0.0
    misfit: float = 0.0
    most_misfit: float = 1.0
    gain_effects: tuple[str, ...] = ()
    delay_effects: tuple[str, ...] = ()
    lag: float = 0.0
    signed: bool = True
    notes: Mapping[str, float] = field(default_factory=dict)

    @property
    def known(self) -> bool:
        """Whether noise leaves anything of gain and delay."""
        return self.gain_se < KNOWN

    @property
    def size(self) -> float:
        """Logarithm of the gain's magnitude."""
        return float(np.log(max(abs(self.gain), 1e-12)))

    def gain_off(self, size: float = 0.0, negative: bool = False) -> bool:
        """Whether the gain contradicts a stated factor exp(size) of either sign."""
        if not self.known:
            return False
        beyond = abs(self.size - size) > self.tolerance + LEVEL * self.gain_se
        return bool(beyond or (self.gain < 0) != negative)

    def delay_off(self, delay: float = 0.0) -> bool:
        """Whether the delay contradicts a stated one (s)."""
        if self.delay is None or not self.known:
            return False
        return bool(abs(self.delay - delay) > self.delay_tolerance + LEVEL * self.delay_se)

    @property
    def shape_off(self) -> bool:
        return self.misfit > self.most_misfit

    @property
    def off(self) -> bool:
        return self.gain_off() or self.delay_off() or self.shape_off


def fit(
    out: np.ndarray,
    inputs: Sequence[np.ndarray],
    frequency: np.ndarray,
    rate: float,
    periodic: bool,
    delays: bool = True,
) -> Fit | None:
    """Gains and delays from one or two inputs to an output.

    Args:
        out: Spectra (s, n) of each period or segment.
        inputs: Likewise, each with its nominal response applied.
        frequency: (n,), Hz.
        rate: Hz, for the reach of the search.
        periodic: Whether means over periods are compared.
        delays: False holds all delays at zero.

    Returns:
        The fit; None where there are too few lines, or no power.
    """
    y = out.mean(axis=0)[None] if periodic else out
    x = np.array([v.mean(axis=0)[None] if periodic else v for v in inputs])
    if frequency.size < LEAST_LINES or not np.any(y) or not np.abs(x).any(axis=(1, 2)).all():
        return None
    w = 2 * np.pi * frequency
    reach = REACH / rate if delays else 0.0
    variance = np.zeros(y.shape)
    for _ in range(2):  # the variance of a line by its own few periods scatters: its inverse, a weight, even more so
        floor = variance + (MODEL * np.abs(y)) ** 2
        weight = 1 / np.maximum(floor, 1e-12 * floor.max())
        gain, delay = _searched(y, x, w, weight, reach, STEP / rate)
        turn = gain[:, None, None] * np.exp(-1j * w * delay[:, None])[:, None]
        rest = out - (turn * np.array(inputs)).sum(axis=0)
        variance = pooled_variance(rest.var(axis=0, ddof=1))[None] / len(rest) if periodic else local_power(rest)
    turned = turn * x
    off = y - turned.sum(axis=0)
    told = np.full(len(gain), float(frequency.size))
    if not periodic:
        share = (weight * np.abs(turned) ** 2).sum(axis=1)
        told = share.sum(axis=1) ** 2 / (share**2).sum(axis=1)
    slopes = [turned / gain[:, None, None]] if not delays else [turned / gain[:, None, None], -1j * w * turned]
    j = np.concatenate(slopes).reshape(-1, y.size)
    normal = np.real((weight.ravel() * j) @ j.conj().T)
    # Twice the weighted power is chi-square; where the residual is larger than the noise, errors grow with it.
    cost = float((weight * np.abs(off) ** 2).sum())
    ratio = max(1.0, cost / max(y.size - len(normal) / 2, 1))
    se = np.sqrt(np.maximum(np.diag(np.linalg.pinv(normal)), 0.0) / 2 * ratio)
    k = len(gain)
    power = (weight * np.abs(y) ** 2).sum()
    left = (weight * (np.abs(off) ** 2 - (variance if periodic else 0.0))).sum() / power
    if not periodic:  # what noise leaves cannot be told from misfit: only what is common to all segments counts
        left = _common(out, rest, weight)
    found = np.zeros(k) if not delays else se[k:]
    return Fit(gain, delay, se[:k] / np.abs(gain), found, float(np.sqrt(max(left, 0.0))), cost, told)


def _searched(
    y: np.ndarray, x: np.ndarray, w: np.ndarray, weight: np.ndarray, reach: float, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Gains and delays that leave the least weighted power, for y (s, n), inputs x (k, s, n) and w (n,) in rad/s."""
    cross = (weight * y * x.conj()).sum(axis=1)  # what a delay turns is the same in every segment
    a = (weight * np.abs(x) ** 2).sum(axis=(1, 2))
    both = (weight * x[0] * x[-1].conj()).sum(axis=0)
    centre, half = np.zeros(len(x)), reach
    points = max(1, 2 * round(reach / step) + 1)
    while True:
        grids = [c + (np.linspace(-half, half, points) if half else np.zeros(1)) for c in centre]
        turn = [_turns(g, w) for g in grids]  # e^(jwd): of the output against a delayed input
        b = [np.real(t @ v) for t, v in zip(turn, cross, strict=True)]
        if len(x) == 1:
            best = (int(np.argmax(b[0] ** 2)),)
            gain = np.array([b[0][best[0]] / a[0]])
        else:
            c = np.real((turn[0].conj() * both) @ turn[1].T)
            determinant = np.maximum(a[0] * a[1] - c**2, 1e-12 * a[0] * a[1])
            g0 = (a[1] * b[0][:, None] - c * b[1][None]) / determinant
            g1 = (a[0] * b[1][None] - c * b[0][:, None]) / determinant
            won = g0 * b[0][:, None] + g1 * b[1][None]
            best = np.unravel_index(int(np.argmax(won)), won.shape)
            gain = np.array([g0[best], g1[best]])
        centre = np.array([g[i] for g, i in zip(grids, best, strict=True)])
        if half < FINEST * step or not half:
            return np.where(gain == 0, 1e-12, gain), centre
        spacing = 2 * half / (points - 1)
        half, points = 1.5 * spacing, FINE


def _turns(delays: np.ndarray, w: np.ndarray) -> np.ndarray:
    """exp(j w d) for evenly spaced delays (m,), (m, n); repeated products are much faster than exponentials."""
    step = delays[1] - delays[0] if delays.size > 1 else 0.0
    factors = np.tile(np.exp(1j * w * step), (delays.size, 1))
    factors[0] = np.exp(1j * w * delays[0])
    return np.multiply.accumulate(factors, axis=0)


def local_power(rest: np.ndarray) -> np.ndarray:
    """Residual power (s, n), averaged over segments and neighbouring bins."""
    return np.broadcast_to(scipy.ndimage.uniform_filter1d((np.abs(rest) ** 2).mean(axis=0), NEIGHBOURS), rest.shape)


def _common(out: np.ndarray, rest: np.ndarray, weight: np.ndarray) -> float:
    """Share of the output's power that the residual holds as one response in all segments.

    Noise of the output is in the residual and in the output, and noise of the inputs in the residual and in what they
    make, so what is common to the residual and to both of these counts.
    """
    power = np.maximum((np.abs(out) ** 2).sum(axis=0), 1e-300)
    shares = []
    for by in (out, out - rest):
        own = np.maximum((np.abs(by) ** 2).sum(axis=0), 1e-300)
        response = (rest * by.conj()).sum(axis=0) / own
        scatter = (np.abs(rest - response * by) ** 2).sum(axis=0) / max(len(out) - 1, 1)
        shares.append(np.maximum(np.abs(response) ** 2 * own - scatter, 0.0) / power)
    power = (weight * np.abs(out) ** 2).sum(axis=0)
    return float((power * np.minimum(*shares)).sum() / power.sum())


def low_pass(
    out: np.ndarray, source: np.ndarray, frequency: np.ndarray, rate: float, periodic: bool, misfit: float
) -> tuple[float, Fit | None]:
    """A first-order low-pass between two channels that explains more than a delay does.

    Returns:
        Its time constant (s), negative where it is the source that is filtered, 0.0 where none explains more; and the
        fit behind it.
    """
    best, found = 0.0, None
    least = 0.5 * misfit
    for size in np.geomspace(0.05, 200.0, 60) / rate:
        for sign in (1, -1):
            pole = 1 / (1 + 2j * np.pi * frequency * size)
            left, right = (out, source * pole) if sign > 0 else (out * pole, source)
            one = fit(left, [right], frequency, rate, periodic, delays=False)
            if one is not None and one.misfit < least and one.gain[0] > 0:
                least, best, found = one.misfit, float(sign * size), one
    return best, found
