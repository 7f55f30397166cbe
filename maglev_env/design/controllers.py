"""The controller of a rig in words: PID gains with filters in series, as `--controller` states them."""

import re
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from maglev_env.design.controller_fit import fitted_gains
from maglev_env.loop.filtered_pid import Filter, FilteredPid, LeadLag, LowPass, Notch
from maglev_env.loop.gains import Controller, Gains, digital, form_of
from maglev_env.loop.linear_controller import LinearController
from maglev_env.rig.rig import Rig

PID = "pid"
FILTERS: Mapping[str, type[Filter]] = {"notch": Notch, "lead_lag": LeadLag, "low_pass": LowPass}
_PLACES = {"notch": ("notch", "notch2"), "lead_lag": ("lead_lag",), "low_pass": ("low_pass",)}
EXAMPLE = "pid + notch 650 depth=0.1 + low_pass 3000"


def with_controller(rig: Rig, text: str | None) -> Rig:
    """The rig with PID gains and the filters of a text in place of its controllers.

    The PID's gains are the rig's own. Of a rig whose controller is given by numerator and denominator, all values are
    those of `controller_fit.fitted_gains`, which starts from the text.

    Args:
        rig: with gains.
        text: "pid", then filters behind "+": a name of FILTERS, its frequency in Hz, and other values as name=value;
            without a frequency the rig's own filter of that name. None: the rig as it is.

    Raises:
        ValueError: The text is not understood, a filter does not fit the control rate, or the rig's controller has no
            PID gains.
    """
    if text is None:
        return rig
    if rig.gains is None:
        raise ValueError(f"--controller: rig {rig.name} has no gains; see defaults.with_defaults")
    pair = rig.gains if isinstance(rig.gains, tuple) else (rig.gains,)
    dt, found = 1 / rig.control_rate, []
    for own in pair:
        stated = _filters(text, own)
        try:
            found.append(_with_filters(own, stated, dt))
            digital(found[-1], dt)
        except ValueError as error:
            raise ValueError(f"--controller {text!r}: rig {rig.name}: {error}") from None
    return replace(rig, gains=tuple(found) if isinstance(rig.gains, tuple) else found[0])


def _with_filters(own: Controller, stated: Mapping[str, Any], dt: float) -> Gains | FilteredPid:
    if isinstance(own, LinearController):
        return fitted_gains(own, stated, dt)
    if not isinstance(own, Gains | FilteredPid):
        raise ValueError(
            f'its controller is of the form "{form_of(own)}", which takes no filters; its own gains can be tuned '
            "without --controller"
        )
    gains: dict[str, Any] = {f.name: getattr(own, f.name) for f in fields(Gains)}
    return FilteredPid(**gains, **stated) if stated else Gains(**gains)


def _filters(text: str, own: Controller) -> dict[str, Filter]:
    """The filters of a text by their place in `FilteredPid`.

    Raises:
        ValueError: The text is not understood.
    """
    first, *parts = [part.split() for part in re.split(r"\+(?!\d)", text)]  # not within 1e+3
    if first != [PID]:
        raise ValueError(f"--controller {text!r}: begin with {PID!r}, then filters behind '+', as in {EXAMPLE!r}")
    found: dict[str, Filter] = {}
    for words in parts:
        kind = words[0].replace("-", "_") if words else ""
        if kind not in FILTERS:
            raise ValueError(f"--controller {text!r}: no filter {kind!r}; filters are {', '.join(FILTERS)}")
        free = [place for place in _PLACES[kind] if place not in found]
        if not free:
            raise ValueError(f"--controller {text!r}: at most {len(_PLACES[kind])} of {kind}")
        before = getattr(own, free[0], None)
        try:
            values = _values(words[1:], [f.name for f in fields(FILTERS[kind])])
            if before is None and "frequency" not in values:
                raise ValueError(f"give its frequency in Hz, as in '{kind} 650'")
            found[free[0]] = replace(before, **values) if before else FILTERS[kind](**values)
        except ValueError as error:
            raise ValueError(f"--controller {text!r}: {kind}: {error}") from None
    return found


def _values(words: list[str], known: list[str]) -> dict[str, float]:
    """Values by name; one without a name is the first known one's."""
    values: dict[str, float] = {}
    for word in words:
        name, _, number = word.rpartition("=")
        name = name or known[0]
        if name not in known or name in values:
            raise ValueError(f"{word!r}: give each of {', '.join(known)} once")
        try:
            values[name] = float(number)
        except ValueError:
            raise ValueError(f"{word!r} is not a number") from None
    return values
