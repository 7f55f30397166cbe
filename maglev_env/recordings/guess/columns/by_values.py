"""Channels of columns whose names say nothing, by what their values do."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from maglev_env.recordings.guess import behaviour as shown
from maglev_env.recordings.guess.columns.column_guess import ColumnGuess
from maglev_env.recordings.guess.evidence import LIKELY, OPEN, SURE
from maglev_env.recordings.guess.units import Unit


def by_behaviour(
    guesses: dict[str, ColumnGuess], values: Mapping[str, np.ndarray], units: Mapping[str, Unit | None]
) -> dict[str, ColumnGuess]:
    """Fill in channels of columns whose names say nothing; of those with a unit, the channels that it allows."""
    guesses = dict(guesses)

    def unknown(si: str = "") -> list[str]:
        """Names without a guess; si: those whose unit is not another one, or that of a transducer."""
        own = {n: unit.si for n, unit in units.items() if unit}
        return [n for n, g in guesses.items() if not g.reason and (not si or own.get(n, si) in (si, "V"))]

    def taken() -> dict[str, str]:
        return {g.channel: n for n, g in guesses.items() if g.channel}

    def take(name: str, channel: str, reason: str, sure: float) -> None:
        ask = f"whether this column is the {channel}" if channel and sure < SURE else ""
        guesses[name] = replace(guesses[name], channel=channel, reason=reason, confidence=sure, ask=ask)

    for n in unknown():
        if shown.is_constant(values[n]):
            take(n, "", f"{values[n][0]:g} in every sample", SURE)
        elif "time" not in taken() and shown.is_time(values[n]):
            take(n, "time", "rises all the time with equal steps", SURE)
        elif shown.is_time(values[n]):
            take(n, "", "a second column that rises with equal steps: a counter", SURE)
    for n in unknown():
        others = {
            o: values[o] for o, g in guesses.items() if o != n and g.channel in ("", "displacement") and o in values
        }
        others = {o: v for o, v in others.items() if not shown.is_constant(v) and not shown.is_time(v)}
        of, match = shown.derivative_of(values[n], others)
        if of and shown.roughness(values[of]) < 0.2:
            take(n, "", f"follows the slope of {of} (correlation {match:.2f}): its velocity", LIKELY)
    for n in unknown():
        if not {"reference", "reference_x"} & taken().keys() and (count := shown.steps_in(values[n])):
            take(n, "reference", f"piecewise constant, {count} changes", LIKELY)
    if "displacement" not in taken() and "displacement_x" not in taken():
        _displacement(unknown("m"), taken(), values, take)
    _pair(unknown("A"), taken(), values, take)
    left = unknown()
    for n in left:
        if "voltage" not in taken() and "command" in taken() and "current" in taken() and n in unknown("V"):
            take(n, "voltage", "what is left beside command and current", OPEN)
        elif "command" not in taken() and len(left) == 1 and "displacement" in taken() and n in unknown("A"):
            take(n, "command", "the only column left beside the displacement", OPEN)
        else:
            take(n, "", "neither its name nor its values say what it is", 0.0)
            guesses[n] = replace(guesses[n], ask="which channel it is, if any")
    return guesses


def _displacement(names: list[str], taken: Mapping[str, str], values: Mapping[str, np.ndarray], take) -> None:
    """The displacement: nearest to the reference in size, else the smoothest."""
    if not names:
        return
    if "reference" in taken:
        wanted = values[taken["reference"]]
        apart = {n: abs(np.median(values[n]) - np.median(wanted)) + values[n].std() for n in names}
        best = min(apart, key=lambda n: apart[n])
        size = abs(np.median(wanted)) + wanted.std()
        if apart[best] < 3 * size:
            return take(best, "displacement", "of all columns nearest to the reference in size", LIKELY)
    best = min(names, key=lambda n: shown.roughness(values[n]))
    return take(best, "displacement", "the smoothest column", OPEN)


def _pair(names: list[str], taken: Mapping[str, str], values: Mapping[str, np.ndarray], take) -> None:
    """Command and current: two columns of one size that move together, the command first."""
    known = taken.get("command") or taken.get("current")
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            if not known and (close := shown.alike(values[a], values[b])):
                first, then = (a, b) if shown.leads(values[a], values[b]) else (b, a)
                take(first, "command", f"moves as {then} (correlation {close:.3f}), before it", LIKELY)
                return take(then, "current", f"moves as {first} (correlation {close:.3f}), after it", LIKELY)
    if known and not {"command", "current"} <= taken.keys():
        missing = "current" if "command" in taken else "command"
        for n in names:
            if close := shown.alike(values[n], values[known]):
                return take(n, missing, f"moves as {known} (correlation {close:.3f})", LIKELY)
    return None
