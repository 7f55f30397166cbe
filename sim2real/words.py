"""Values with their errors, shares and names of parameters, as a report writes them."""

from math import floor, isfinite, log10
from typing import TypedDict

from maglev_env.units import prefixed

AT_BOUND, NOT_TOLD = "at its bound, not identified", "not identified"
_DIGITS = 4
LARGE = 1e6  # from which a value has a power of ten, in units without a prefix
DUST = 1e-9  # below which a number without a unit is what rounding leaves of 0
LOST = 1e-2  # standard errors below which a value is lost in its error, which then has the unit
UNTOLD = 3.0  # standard errors over the value from which on a size says nothing
NO_ERROR = 1e-8  # of the value: a smaller standard error belongs to a parameter that the recordings do not determine


class Fitted(TypedDict):
    """A fitted parameter as JSON data.

    Attributes:
        value: SI, or the relative change.
        se: Its standard error; None where it is not known.
        at_bound: Whether the fit ended at an end of the range that it searches, so that the value is no estimate.
    """

    value: float
    se: float | None
    at_bound: bool


def quantity(value: float, se: float | None, unit: str, is_change: bool = False) -> str:
    """A value with its standard error in a readable unit: "75.0 +- 1.2 µs"; "+3.1 +- 0.4 %" for a relative change."""
    if is_change:
        return f"{_with_se(100 * value, se and 100 * se, '+')} %"
    if not unit and abs(value) < DUST:
        value = 0.0
    factor, shown = prefixed(value if abs(value) > LOST * (se or 0.0) else se or 0.0, unit)
    return f"{_with_se(value * factor, se and se * factor)} {shown}".rstrip()


def fitted_quantity(at: Fitted, unit: str, is_change: bool, errors: float = 1.0) -> str:
    """A fitted parameter with so many standard errors; without an interval and said not to be told where it is at its
    bound, or where its error is larger than itself by far."""
    if not is_change and at["se"] and at["value"] and at["se"] > UNTOLD * abs(at["value"]):
        return f"{quantity(at['value'], None, unit)} ({NOT_TOLD})"
    text = quantity(at["value"], at["se"] and errors * at["se"], unit, is_change)
    return f"{text} ({AT_BOUND})" if at["at_bound"] else text


def _with_se(value: float, se: float | None, sign: str = "") -> str:
    if not se or not isfinite(se) or se < NO_ERROR * abs(value):
        return f"{value:{sign}.3g}"
    if abs(value) >= LARGE:
        power = floor(log10(abs(value)))
        return f"({_with_se(value / 10.0**power, se / 10.0**power, sign)})e{power}"
    places = 1 - floor(log10(se))
    if value:
        places = min(places, _DIGITS - 1 - floor(log10(abs(value))))
    places = max(places, 0)
    error = f"{se:.{places}f}" if float(f"{se:.{places}f}") else f"{se:.1g}"
    value = value if round(value, places) else 0.0  # not "-0.0"
    return f"{value:{sign}.{places}f} +- {error}"


def spoken(name: str, with_effect: bool) -> str:
    """A parameter "effect.parameter" in words, with or without the name of its effect."""
    effect, _, key = name.partition(".")
    words = key.removesuffix("_hz").replace("_", " ")
    return f"{effect} {words}" if with_effect else words


def percent(share: float) -> str:
    """A share or probability in per cent; values close to 0 or 1 are given as "< 1 %" or "> 99 %"."""
    if share > 0.995:
        return "> 99 %" if share < 1 else "100 %"
    return "< 1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"
