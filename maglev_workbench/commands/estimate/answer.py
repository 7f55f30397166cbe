"""The answer of `maglev estimate` in one sentence: stiffness, damping and actuator gain over the trusted band."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from estimation.normal import NORMAL_95
from estimation.stiffness_pole import stiffness_pole
from maglev_env.evaluation.bands import Band
from maglev_env.evaluation.identification import Identification
from maglev_env.rig.rig import Rig
from maglev_env.units import prefixed
from maglev_workbench.commands.estimate.figures import COEFFICIENTS
from maglev_workbench.commands.estimate.report import trust
from maglev_workbench.commands.estimate.stated_rig import Found, from_stated, of_axis_named
from maglev_workbench.page import number, with_interval
from sim2real.coefficients import Coefficient
from sim2real.pooled import Pooled
from sim2real.recorded.at_rest.static_evidence import AT_REST
from sim2real.words import AT_BOUND

LINEAR = (
    "by linear responses alone, because the rig could not be fitted: these intervals are of noise, and hold neither "
    "what a large motion changes nor timing; take them for a first look"
)
AT_THIS_MOTION = (
    "these are of the linear response at this motion, and the excitation does not tell how far a smaller one differs; "
    "name the rig, and its force law is fitted"
)
LACKS = 2.0  # times the noise, from which on what the rig's model leaves is worth a look for a second body
LEAST_OWN = 0.05  # share of a band's standard error that is its own, where a common one is taken off
STEADY = (
    4.0  # mean square of the bands' deviations, in their standard errors, up to which a coefficient is one constant
)


@dataclass(frozen=True)
class Constant:
    """A coefficient over the trusted bands, SI.

    Attributes:
        value: Its weighted mean over bands that do not overlap.
        interval: Its 95 % interval, widened by the bands' scatter, with the errors that they have in common; the
            smallest and largest value where it varies.
        varies: Whether it varies with frequency by more than its uncertainty.
    """

    value: float
    interval: tuple[float, float]
    varies: bool


def trusted(bands: Sequence[Band]) -> list[Band]:
    """Bands that bound their coefficients and that constant coefficients describe, without overlap.

    Where the mass or the noise rules, an interval may have two ends and say nothing of the stiffness: one that is wider
    than the stiffness of the best band is large does not count.
    """
    sure = [band for band in bands if trust(band) in ("either", "ML")]
    best = min(sure, key=_spread, default=None)
    found: list[Band] = []
    for band in sure:
        known = best is not None and _spread(band) <= max(abs(best.stiffness), _spread(best))
        if known and (not found or band.f_lo >= found[-1].f_hi):
            found.append(band)
    return found


def _spread(band: Band) -> float:
    """Half the width of the interval of the stiffness, N/m."""
    low, high = band.stiffness_ci
    return (high - low) / 2


def over_bands(bands: Sequence[Band], name: str) -> Constant:
    """A coefficient over bands that do not overlap.

    Their own errors average out; those that they have in common, as of the mass or the actuator gain, do not.
    """
    value = np.array([getattr(b, name) for b in bands])
    low, high = np.array([getattr(b, f"{name}_ci") for b in bands]).T
    error = (high - low) / (2 * NORMAL_95)
    weight = error**-2.0
    mean = float(np.average(value, weights=weight))
    if value.size == 1:
        return Constant(mean, (float(low[0]), float(high[0])), False)
    moved = _common(bands, name)
    own = _own(error, moved)
    # What remains of the deviations where each common error takes the size, in its standard errors, that explains most.
    columns = np.column_stack([np.ones(value.size), moved]) / own[:, None]
    prior = np.eye(columns.shape[1])[1:]
    free, told = np.vstack([columns, prior]), np.append((value - mean) / own, np.zeros(len(prior)))
    left = told - free @ np.linalg.lstsq(free, told)[0]
    scatter = float(left @ left) / (value.size - 1)
    # A deviation that the common errors explain, or that is small beside them, is no change with frequency.
    if min(scatter, np.sum(weight * (value - mean) ** 2) / (value.size - 1)) > STEADY:
        return Constant(mean, (float(value.min()), float(value.max())), True)
    variance = max(scatter, 1.0) * np.sum(weight**2 * own**2) + np.sum((weight @ moved) ** 2)
    half = NORMAL_95 * float(np.sqrt(variance)) / weight.sum()
    return Constant(mean, (mean - half, mean + half), False)


def _common(bands: Sequence[Band], name: str) -> np.ndarray:
    """(bands, errors): by how much one standard error of each that all bands have in common moves a coefficient, SI."""
    axis = tuple(COEFFICIENTS).index(name)
    errors = len(bands[0].common) if bands else 0
    return np.array([[both[axis] for both in b.common] for b in bands]).reshape(len(bands), errors)


def _own(error: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Of the bands' standard errors (bands,) what each has alone, without the common ones (bands, errors)."""
    return np.sqrt(np.maximum(error**2 - np.sum(moved**2, axis=1), (LEAST_OWN * error) ** 2))


def estimate_answer(
    results: Sequence[tuple[str, Identification]], pooled: Pooled | None, linear: bool = False, rig: Rig | None = None
) -> str:
    """One sentence on recordings (file, identification), and on all of them together where the rig was fitted.

    Args:
        results: of each recording.
        pooled: the rig in all recordings.
        linear: whether the rig could not be fitted, although it is named: responses alone take any motion for small.
        rig: as it is stated, from which the answer may be far; None: none is.
    """
    if pooled is not None:
        jumps = (_second_body(found) for _, found in results if pooled.misfit > LACKS)
        far = [Found(c.name, c.value, c.se, c.nominal) for c in pooled.coefficients if c.identified]
        return f"{_of_all(pooled).removesuffix('.')}{next(filter(None, jumps), '')}{from_stated(rig, far)}."
    file, found = max(results, key=lambda one: len(trusted(one[1].bands)))
    among = f"{file}: " if len(results) == 1 else f"{file}, which bounds most of {len(results)} recordings: "
    sure = trusted(found.bands)
    if not sure:
        return f"{among}no band bounds stiffness and damping; `maglev check` says what to record instead."
    constants = {name: over_bands(sure, name) for name in COEFFICIENTS}
    steady = [_in_words(name, one) for name, one in constants.items() if not one.varies]
    varying = [_in_words(name, one) for name, one in constants.items() if one.varies]
    if found.actuator is not None:
        gain, se = found.actuator.gain, found.actuator.gain_se
        scale, unit = prefixed(gain, "N/A")
        half = NORMAL_95 * se * scale
        steady.append(f"actuator gain {with_interval(gain * scale, gain * scale - half, gain * scale + half)} {unit}")
    without = " without the controller" if found.actuator is not None else ""
    # What varies is told by the values of the bands, which no 95 % belong to.
    values = f"{', '.join(steady)}{'' if varying else without} (95 %)" if steady else ""
    values = ", ".join(filter(None, (values, *varying))) + (without if varying else "")
    said = f"{among}{values}, trusted from {sure[0].f_lo:.4g} to {sure[-1].f_hi:.4g} Hz{_second_body(found)}"
    if rig is not None and (told := found.actuator) is not None:
        said += from_stated(
            rig, of_axis_named(rig, file, (told.gain, told.gain_se), (told.stiffness, told.stiffness_se))
        )
    bent = found.distortion
    mind = LINEAR if linear else AT_THIS_MOTION if found.actuator and bent.even is None and bent.odd is None else ""
    return f"{said}; {mind}." if mind else f"{said}."


def _second_body(found: Identification) -> str:
    """What a stiffness says that jumps where a second body resonates."""
    apart: list[Band] = []
    for band in found.bands:
        if not apart or band.f_lo >= apart[-1].f_hi:
            apart.append(band)
    middle = np.array([(b.f_lo + b.f_hi) / 2 for b in apart])
    stiffness, error = np.array([(b.stiffness, b.stiffness_se) for b in apart]).reshape(-1, 2).T
    # An error of the gain or the mass is that of all bands alike, and makes no jump between two of them.
    pole = stiffness_pole(middle, stiffness, _own(error, _common(apart, "stiffness")))
    if pole is None:
        return ""
    scale, unit = prefixed(max(pole.stiffness, key=abs), "N/m")
    below, above = (number(k * scale) for k in pole.stiffness)
    low, high = pole.frequency
    return (
        f"; from {low:.4g} to {high:.4g} Hz the stiffness jumps from {below} to {above} {unit}, as where a second body "
        "resonates (a rotor that bends, a support that gives way): no single mass describes this rig there, and "
        "`maglev diagnose` fits it"
    )


def _in_words(name: str, found: Constant) -> str:
    scale, unit = prefixed(found.value, COEFFICIENTS[name])
    low, high = (end * scale for end in found.interval)
    if found.varies:
        return f"{name} varying from {number(low)} to {number(high)} {unit}"
    return f"{name} {with_interval(found.value * scale, low, high)} {unit}"


def _of_all(found: Pooled) -> str:
    parts = [_coefficient(c) for c in found.coefficients if c.identified]
    if rest := [_coefficient(c) for c in found.of_each.get(AT_REST, ())]:
        text = f"At rest, by {AT_REST}: {', '.join(rest)} (95 %); in motion, all recordings together: "
        text += "" if parts else "no coefficient is bounded"
    else:
        of_all = "The rig in all recordings: " if found.moving else f"At rest, by {AT_REST}: "
        text = of_all if parts else "The recordings bound no coefficient"
    text += f"{', '.join(parts)} (95 %)" if parts else ""
    text += "" if found.moving else "; of its motion nothing is told"
    for why, those in (
        ("not bounded", [c for c in found.coefficients if not c.bounded]),
        (AT_BOUND, [c for c in found.coefficients if c.bounded and c.at_limit]),
    ):
        names = ", ".join(c.name.replace("_", " ") for c in those)
        text += f"; {why}: {names}" if those and (parts or why == AT_BOUND) else ""
    apart = ["rest and motion contradict each other"] if found.contradictions else []
    if found.disagreements:
        apart.append(f"the recordings disagree about {_listed(found.disagreements)}")
    return text + (f"; {' and '.join(apart)}." if apart else ".")


def _listed(names: Iterable[str]) -> str:
    """Names of coefficients in words: "the delay, the damping and the actuator gain"."""
    *first, last = (f"the {name.replace('_', ' ')}" for name in names)
    return f"{', '.join(first)} and {last}" if first else last


def _coefficient(c: Coefficient) -> str:
    scale, unit = prefixed(max(c.interval, key=abs), c.unit)
    return f"{c.name.replace('_', ' ')} {with_interval(c.value * scale, *(end * scale for end in c.interval))} {unit}"
