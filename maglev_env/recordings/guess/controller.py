"""Is the command exactly a PID filter of the displacement? Then its gains are known without a word from the user."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from maglev_env.loop.gains import Gains

_MOST = 4000  # samples that are fitted
_EXACT = 1.0  # rms residual of an exact fit, in steps of the converter
_ROUNDING = 1e-6  # of the command's standard deviation, where the command has no steps
_FEWEST_DIGITS = 5  # fewer are a converter's steps
_CLOSE = 3e-3  # of its standard deviation, that is left of a command whose PID is known for every purpose
_CANCELLING = 30.0
_LOOSE = 4.0  # of that, for the search of the time constants, which ends before
_AS_WELL = 1.02  # of the residual of all three parts
NO_LEAK = 1e3  # s: the ti of an integral whose leak a record does not tell
_TD, _TI = np.geomspace(0.3, 300.0, 12), np.geomspace(20.0, 1e5, 8)  # samples


@dataclass(frozen=True)
class ControllerFit:
    """The PID that fits a command best.

    Args:
        gains: in A/m, A/m, A s/m, s, s, for the displacement as it is given; ti is NO_LEAK where the record tells
            only ki / ti.
        bias: A, constant part of the command.
        residual: rms of what the fit leaves, A.
        step: step of the command's converter, A.
        share: of the command's variance that the fit leaves.
        exact: whether nothing but the converter's rounding is left.
        close: whether no more is left than another discretisation or a forgotten initial value explains.
        late: samples by which the command follows.
    """

    gains: Gains
    bias: float
    residual: float
    step: float
    share: float
    exact: bool
    late: int
    close: bool = False


def fit_controller(
    displacement: np.ndarray,
    command: np.ndarray,
    rate: float,
    reference: np.ndarray | None = None,
    injection: np.ndarray | None = None,
    known: np.ndarray | None = None,
) -> ControllerFit | None:
    """Fit the recursion of `loop.gains` to a recorded command.

    Args:
        displacement: m, (samples,).
        command: A, (samples,).
        rate: Hz.
        reference: m, (samples,); None: constant.
        injection: A, (samples,), part of the command; None: none.
        known: samples that count, (samples,) bool; None: all.

    Returns:
        The best of PID controllers that answer at once or one sample late; None where the command does not move.
    """
    error = -displacement if reference is None else reference - displacement
    wanted = command if injection is None else command - injection
    # Where the command rests at its limits it is no linear filter of anything.
    free = (command > command.min()) & (command < command.max())
    free = free if known is None else free & known
    begin = _liveliest(free, min(_MOST, command.size))
    window = slice(begin, begin + _MOST)
    error, wanted, free = error[window], wanted[window], free[window]
    if free.sum() < 50 or np.ptp(wanted[free]) == 0 or np.ptp(error[free]) == 0:
        return None
    spread = float(wanted[free].std())
    steps = np.diff(np.unique(command[window]))
    step = float(np.min(steps[steps > 1e-9 * spread], initial=np.inf))
    # A command that moves by a few steps alone is matched within a step by anything.
    enough = min(max(_EXACT * step if np.isfinite(step) else 0.0, _ROUNDING * spread), 0.05 * spread)
    signals = (error, wanted, free, rate)
    residual, gains, bias, late = _fit(*signals, 0)
    if residual > enough:
        residual, gains, bias, late = min((residual, gains, bias, late), _fit(*signals, 1), key=_first)
    exact = residual <= max(enough, min(_rounded(gains, error, wanted, rate), 0.05 * spread))
    if _cancels(
        gains
    ):  # two parts of one time constant, in place of anything: the simplest that is there is looked for
        residual, gains, bias, late = min((_fit(*signals, late, parts) for parts in ("", "d", "i")), key=_first)
        exact = residual <= max(enough, min(_rounded(gains, error, wanted, rate), 0.05 * spread))
    close = exact or residual <= _CLOSE * spread
    for parts in ("", "d", "i") if close else ():
        # Parts that the record does not show would get gains that cancel: the simplest that does as well is stated.
        simpler = _fit(*signals, late, parts)
        if simpler[0] <= _AS_WELL * residual + _ROUNDING * spread:
            residual, gains, bias, late = simpler
            break
    if close and gains.ki:
        pure = _fit(*signals, late, "di" if gains.kd else "i", NO_LEAK * rate)
        if pure[0] <= _AS_WELL * residual + _ROUNDING * spread:
            residual, gains, bias, late = pure
    return ControllerFit(gains, bias, residual, step, (residual / spread) ** 2, exact, late, close)


def _cancels(gains: Gains) -> bool:
    """Whether the parts of a PID are far larger than what they make together, at rest and at once."""
    slope = gains.kd / gains.td if gains.td else 0.0
    together = max(abs(gains.kp + gains.ki), abs(gains.kp + slope))
    return max(abs(gains.kp), abs(gains.ki), abs(slope)) > _CANCELLING * together


def _rounded(gains: Gains, error: np.ndarray, wanted: np.ndarray, rate: float) -> float:
    """rms of what the digits of the columns leave of an exact PID, A: a derivative enlarges the displacement's."""
    low = np.exp(-1 / (gains.td * rate))
    slope = gains.kd / gains.td if gains.td else 0.0
    # Impulse response: kp + slope at once, then the derivative's filter dies away.
    gain = np.sqrt((gains.kp + slope) ** 2 + (slope * (1 - low)) ** 2 / max(1 - low**2, 1e-12))
    return _LOOSE * float(np.hypot(gain * _digits(error), _digits(wanted)))


def _digits(values: np.ndarray) -> float:
    """rms error of values that carry so many significant digits, or single precision; 0 where neither limits them."""
    if np.array_equal(values.astype(np.float32), values):
        return float(np.sqrt(np.mean(values**2))) * 2.0**-24 / np.sqrt(3)
    power = 10.0 ** np.floor(np.log10(np.maximum(np.abs(values), 1e-300)))
    for digits in range(_FEWEST_DIGITS, 12):
        unit = power * 10.0 ** (1 - digits)
        if np.all(np.abs(values - np.round(values / unit) * unit) <= 1e-6 * unit):
            return float(np.sqrt(np.mean(unit**2) / 12))
    return 0.0


def _first(fit: tuple[float, Gains, float, int]) -> float:
    return fit[0]


def _liveliest(free: np.ndarray, length: int) -> int:
    """Start of the window with the most samples away from the limits."""
    inside = np.concatenate([[0], np.cumsum(free)])
    return int(np.argmax(inside[length:] - inside[:-length]))


def _fit(
    error: np.ndarray,
    wanted: np.ndarray,
    free: np.ndarray,
    rate: float,
    late: int,
    parts: str = "di",
    ti: float | None = None,
) -> tuple[float, Gains, float, int]:
    """Residual, gains and bias of the best PID; the time constants by search, the rest by least squares.

    Beside the proportional part it has a derivative ("d") and an integral one ("i") where `parts` says so; the latter
    sums up without a leak where `ti` (samples) is stated, which then only scales its gain.
    """
    if late:
        error, wanted, free = error[:-late], wanted[late:], free[late:]
    n, moved, kept = np.arange(error.size), error - error[0], slice(None) if free.all() else free
    left = wanted[kept]
    # The limit of a long leak: what its filter held, and a mean that the file's zero adds, are a constant and a ramp.
    pure = None if ti is None else [(np.cumsum(moved) - moved) / ti, n]

    def columns(td: float, ti: float) -> np.ndarray:
        found = [error, np.ones(error.size)]
        for part, constant in (("d", td), ("i", ti)):
            if part in parts:
                if part == "i" and pure is not None:
                    found += pure
                    continue
                a = np.exp(-1 / constant)
                low = scipy.signal.lfilter([0.0, 1 - a], [1.0, -a], moved)
                # Beside the part itself: what its filter held when the record began.
                found += [moved - low if part == "d" else low, np.exp(-n / constant)]
        return np.stack(found)[:, kept]

    def solve(td: float, ti: float) -> tuple[float, np.ndarray]:
        matrix = columns(td, ti)
        scale = np.maximum(np.sqrt(np.einsum("ij,ij->i", matrix, matrix) / left.size), 1e-300)
        matrix /= scale[:, None]
        solution = np.linalg.lstsq(matrix.T, left, rcond=1e-13)[0]
        rest = left - solution @ matrix
        return float(np.sqrt(rest @ rest / left.size)), solution / scale

    best = _search(lambda td, ti: solve(td, ti)[0], parts if ti is None else parts.replace("i", ""))
    residual, (kp, bias, *rest) = solve(*best)
    td, ti = best[0] / rate, (best[1] if ti is None else ti) / rate
    slope, ki = rest[0] if "d" in parts else 0.0, rest[-2] if "i" in parts else 0.0
    return residual, Gains(float(kp), float(ki), float(slope * td), td, ti), float(bias), late


def _search(residual: Callable[[float, float], float], parts: str) -> tuple[float, float]:
    """The time constants in samples with the least residual."""
    if not parts:
        return 1.0, 1.0
    tds, tis = _TD if "d" in parts else _TD[:1], _TI if "i" in parts else _TI[:1]
    grid = sorted((residual(td, ti), td, ti) for td in tds for ti in tis)
    found = []
    for _, td, ti in grid[:2]:
        start = np.log([td, ti])
        result = scipy.optimize.minimize(
            lambda p: np.log(residual(*np.exp(np.clip(p, -3, 14))) + 1e-300),
            start,
            method="Nelder-Mead",
            options={"maxiter": 160, "xatol": 1e-6, "fatol": 1e-6},
        )
        found.append((result.fun, *np.exp(np.clip(result.x, -3, 14))))
    return min(found)[1:]
