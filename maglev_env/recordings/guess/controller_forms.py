"""Is the command a controller of another form: derivative on the measurement, a set-point filter, state feedback?

A plain PID sees reference and displacement alike. Here both have parts of their own, and the current has one, too.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import scipy

_MOST = 4000  # samples that are fitted
_FEWEST = 200
_CLOSE = 3e-3  # of the command's standard deviation, that is left of a command whose controller is known
_COARSE, _MOST_ROUNDED = 1.5, 0.02  # times what coarse steps leave; share of the command's motion that they may be
_AS_WELL = 1.05  # of the residual of a form with more parts
_ROUNDING = 1e-5  # of the command's standard deviation, that no part is needed for
_TD, _TF = (0.0, *np.geomspace(0.3, 100.0, 9)), (0.0, *np.geomspace(1.0, 1000.0, 13))  # samples
_SAME_WEIGHT = 0.01  # deviation of a set-point weight from 1
_REFINED = 4  # of the best time constants, from which a search starts
_HOPELESS = 0.4  # of the command's standard deviation, that they leave of what no such controller makes
_WEIGHTS = (-0.05, 1.05)  # set-point weights of a controller, which are from 0 to 1
# A current follows its command, so that it explains it by itself: such a fit has a gain near -1 of the current, or next
# to nothing of the displacement. A feedback of both has more of the displacement than there is of the command.
_FOLLOWS, _OF_DISPLACEMENT = -0.9, 0.2


@dataclass(frozen=True)
class FormFit:
    """The controller of another form that fits a command.

    Args:
        table: as `controller` of a campaign, in SI.
        residual: rms of what the fit leaves, A.
        share: of the command's standard deviation that it leaves.
    """

    table: Mapping[str, Any]
    residual: float
    share: float


@dataclass(frozen=True)
class _Signals:
    """What a controller may see, (samples,) each: r and y in m, the command and the current (or None) in A; and which
    samples count."""

    reference: np.ndarray
    displacement: np.ndarray
    command: np.ndarray
    current: np.ndarray | None
    step: float  # s
    known: np.ndarray


_Fit = tuple[float, str, float, float]  # residual (A), derivative on, td and set-point filter (samples)


def fit_form(
    displacement: np.ndarray,
    command: np.ndarray,
    rate: float,
    reference: np.ndarray | None = None,
    injection: np.ndarray | None = None,
    current: np.ndarray | None = None,
    known: np.ndarray | None = None,
) -> FormFit | None:
    """Fit a PID whose derivative is on the measurement or behind a set-point filter, or state feedback.

    Args:
        displacement: m, (samples,).
        command: A, (samples,).
        rate: Hz.
        reference: m, (samples,); None: constant.
        injection: A, (samples,), part of the command; None: none.
        current: A, (samples,), that the controller may have read; None: none.
        known: samples that count, (samples,) bool; None: all.

    Returns:
        The form with the fewest parts that leaves no more of the command than another discretisation explains; None
        where none does, or where only one does that no controller has: it follows the current alone, has no
        proportional part, or weighs the reference by less than 0 or more than 1.
    """
    wanted = command if injection is None else command - injection
    reference = np.zeros(wanted.size) if reference is None else reference
    run = _unlimited(command, reference)
    if run.stop - run.start < _FEWEST or np.ptp(wanted[run]) == 0:
        return None
    read = None if current is None else current[run]
    counts = np.ones(wanted.size, bool) if known is None else known
    signals = _Signals(reference[run], displacement[run], wanted[run], read, 1 / rate, counts[run])
    if signals.known.sum() < _FEWEST:
        return None
    spread = float(signals.command.std())
    moved = np.ptp(signals.reference) > 0
    for with_current in (False, True) if read is not None and np.ptp(read) else (False,):
        best = _best(signals, with_current, "measurement", moved)
        if best[0] > _CLOSE * spread and moved and not with_current:
            best = min(best, _best(signals, with_current, "error", moved), key=lambda one: one[0])
        allowed = max(_CLOSE * spread, min(_rounded(signals, with_current, best), _MOST_ROUNDED * spread))
        if best[0] <= allowed and (found := _simplest(signals, with_current, best, spread)) is not None:
            residual, table = found
            return FormFit(table, residual, residual / spread)
    return None


def _rounded(s: _Signals, with_current: bool, best: _Fit) -> float:
    """rms of what the steps of a coarse reading leave of the command, A: a derivative enlarges those that it is of."""
    steps = np.diff(np.unique(s.displacement))
    step = float(np.median(steps)) if steps.size else 0.0
    c = _solved(s, "di", with_current, *best[1:])[1]
    slope = c.get("d", 0.0) / (s.step * (best[2] + 1))
    # A step acts at once, and again with the other sign in the sample behind it.
    return _COARSE * step / np.sqrt(12) * float(np.hypot(c["p"] + slope, slope))


def _unlimited(command: np.ndarray, reference: np.ndarray) -> slice:
    """The longest run without samples at a limit; of a long one the part in which the reference changes most."""
    at = np.zeros(command.size, bool)
    for end in (command.min(), command.max()):
        held = command == end
        at |= held & (np.roll(held, 1) | np.roll(held, -1))
    edges = np.concatenate([[-1], np.flatnonzero(at), [command.size]])
    longest = int(np.argmax(np.diff(edges)))
    begin, end = int(edges[longest]) + 1, int(edges[longest + 1])
    if end - begin <= _MOST:
        return slice(begin, end)
    moves = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(reference[begin:end])))])
    first = begin + int(np.argmax(moves[_MOST - 1 :] - moves[: moves.size - _MOST + 1]))
    return slice(first, first + _MOST)


def _best(s: _Signals, with_current: bool, on: str, moved: bool) -> _Fit:
    """The time constants with which all parts together leave least."""

    def left(td: float, tf: float) -> float:
        return _solved(s, "di", with_current, on, td, tf)[0]

    grid = sorted((left(td, tf), td, tf) for td, tf in product(_TD, _TF if moved else (0.0,)))
    found = [(residual, on, td, tf) for residual, td, tf in grid[:1]]
    for residual, td, tf in grid[:_REFINED]:
        if residual > _HOPELESS * s.command.std():
            break
        free = [i for i, value in enumerate((td, tf)) if value]
        if not free:
            continue

        def at(logs: np.ndarray, start: tuple[float, float] = (td, tf)) -> tuple[float, float]:
            values = list(start)
            for i, log in zip([i for i, v in enumerate(start) if v], logs, strict=True):
                values[i] = float(np.exp(np.clip(log, -3, 12)))
            return values[0], values[1]

        result = scipy.optimize.minimize(
            lambda logs, at=at: np.log(left(*at(logs)) + 1e-300),
            np.log([(td, tf)[i] for i in free]),
            method="Nelder-Mead",
            options={"maxiter": 120, "xatol": 1e-5, "fatol": 1e-6},
        )
        ends = at(result.x)
        found.append((left(*ends), on, *ends))
    return min(found)


def _simplest(s: _Signals, with_current: bool, best: _Fit, spread: float) -> tuple[float, dict[str, Any]] | None:
    """Residual and table of the form with the fewest parts that does as well as all of them; None where it is none."""
    enough = _AS_WELL * best[0] + _ROUNDING * spread
    for parts in ("", "d", "i", "di"):
        residual, c = _solved(s, parts, with_current, *best[1:])
        if (residual <= enough or parts == "di") and _is_one(s, c, _columns(s, parts, with_current, *best[1:]), spread):
            return residual, _table(s, parts, with_current, best, c)
    return None


def _is_one(s: _Signals, c: Mapping[str, float], columns: Mapping[str, np.ndarray], spread: float) -> bool:
    """Whether a controller has such coefficients of the columns (samples,) each."""

    def moved(names: str) -> float:
        made = [c[n] * columns[n][s.known] for n in names if n in c]
        return float(np.std(sum(made))) if made else 0.0

    if moved("p") <= _CLOSE * spread:
        return False
    if "r" in c and not _WEIGHTS[0] <= c["r"] / c["p"] <= _WEIGHTS[1]:
        return False
    return "c" not in c or (c["c"] > _FOLLOWS and moved("prid") > _OF_DISPLACEMENT * spread)


def _table(s: _Signals, parts: str, with_current: bool, best: _Fit, c: Mapping[str, float]) -> dict[str, Any]:
    """The form with these parts and their coefficients as a table of a campaign."""
    _, on, td, tf = best
    filters = {"setpoint_filter": _short(tf * s.step)} if tf and np.ptp(s.reference) else {}
    slope = {"td": _short(td * s.step)} if "d" in parts and td else {}
    if with_current:
        return {
            "form": "state_feedback", "displacement": _short(c["p"]), "velocity": _short(c.get("d", 0.0)),
            "current": _short(c["c"]), "integral": _short(c.get("i", 0.0)),
            **({"velocity_filter": slope["td"]} if slope else {}), **filters,
        }  # fmt: skip
    weight = c["r"] / c["p"] if "r" in c else 1.0
    weighted = {} if abs(weight - 1) < _SAME_WEIGHT else {"setpoint_weight": _short(weight)}
    gains = {name: _short(c[part]) for name, part in (("ki", "i"), ("kd", "d")) if part in c}
    side = {"derivative_on": on} if "d" in parts and on == "measurement" else {}
    return {"form": "pid", "kp": _short(c["p"]), **gains, **slope, **side, **weighted, **filters}


def _short(value: float) -> float:
    return float(f"{value:.5g}")


def _solved(
    s: _Signals, parts: str, with_current: bool, on: str, td: float, tf: float
) -> tuple[float, dict[str, float]]:
    """Residual (A) and coefficients of the columns by least squares."""
    columns = _columns(s, parts, with_current, on, td, tf)
    matrix, command = np.array(list(columns.values()))[:, s.known], s.command[s.known]
    size = np.maximum(np.sqrt(np.einsum("ij,ij->i", matrix, matrix) / command.size), 1e-300)
    solution = np.linalg.lstsq((matrix / size[:, None]).T, command, rcond=1e-12)[0] / size
    rest = command - solution @ matrix
    return float(np.sqrt(rest @ rest / command.size)), dict(zip(columns, map(float, solution), strict=True))


def _columns(s: _Signals, parts: str, with_current: bool, on: str, td: float, tf: float) -> dict[str, np.ndarray]:
    """What a controller sums up, (samples,) each: p of the displacement, r of the reference, i, d, c of the current.

    Beside each filter stands what it held when the record began.
    """
    n = np.arange(s.command.size)
    first, y = s.reference[0], s.displacement - s.displacement[0]
    r = _low_passed(s.reference - first, tf)
    columns = {"one": np.ones(n.size), "p": -y}
    if np.ptp(s.reference):
        columns["r"] = r
        if with_current:  # state feedback weighs both alike
            columns["p"] = columns.pop("r") - y
    if tf and np.ptp(s.reference):
        columns["r held"] = (tf / (tf + 1)) ** n
    if "i" in parts:
        columns["i"] = s.step * np.cumsum(first + r - s.displacement)
    if "d" in parts:
        columns["d"] = _slope(-y if on == "measurement" else r - y, td) / s.step
        if td:
            columns["d held"] = (td / (td + 1)) ** n
    if with_current and s.current is not None:
        columns["c"] = -(s.current - s.current[0])
    return columns


def _low_passed(values: np.ndarray, samples: float) -> np.ndarray:
    """f + (values - f) / (samples + 1), as the set-point filter of a controller."""
    return scipy.signal.lfilter([1 / (samples + 1)], [1.0, -samples / (samples + 1)], values)


def _slope(values: np.ndarray, samples: float) -> np.ndarray:
    """(samples D + change) / (samples + 1), as the derivative of a controller, per sample."""
    change = np.diff(values, prepend=values[:1])
    return scipy.signal.lfilter([1 / (samples + 1)], [1.0, -samples / (samples + 1)], change)
