"""The scale of a column: by its unit, else by the size of its values."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from maglev_env.recordings.guess.columns.column_guess import ColumnGuess, si_unit
from maglev_env.recordings.guess.columns.counts import holds_counts, order_of_a_count
from maglev_env.recordings.guess.columns.sensitivity import sensitivity_of
from maglev_env.recordings.guess.columns.sizes import MOST_SHAKEN, acceleration, step_of, too_slow_for
from maglev_env.recordings.guess.evidence import LIKELY, OPEN
from maglev_env.recordings.guess.rate import stated_step, time_scale
from maglev_env.recordings.guess.units import Unit, unknown_unit

# Sizes up to which the values of a channel without a unit are likely to be in SI; beyond them it is in a smaller unit.
_LARGEST_M = 0.05
_SLOW_M = 0.3  # the same of distances that a slow controller could not hold if they were in mm
_LARGEST_A, _MOST_OF_IT = 60.0, 0.99  # the second: share of a current's values, since single ones may be spikes
NO_UNIT = "no unit"  # begins the evidence for a scale by the size of the values


def scaled(
    guess: ColumnGuess,
    units: Mapping[str, Unit | None],
    values: np.ndarray,
    guesses: Mapping[str, ColumnGuess],
    all_values: Mapping[str, np.ndarray],
    numbers: Mapping[str, float],
) -> ColumnGuess:
    """The guess with its scale; without a unit in the header, by the size of the values."""
    if not guess.channel:
        return guess
    si, unit = si_unit(guess.channel), units[guess.column]
    if unit and unit.si == si:
        return replace(guess, scale=unit.scale)
    if unit and (sensed := sensitivity_of(guess.column, si, unit, numbers)):
        scale, why = sensed
        return replace(guess, scale=scale, reason=f"{guess.reason}; {why}")
    if unit:
        ask = f"scale in {si} per {unit.text}"
        return replace(guess, ask=ask, confidence=min(guess.confidence, OPEN))
    text = "" if holds_counts(guess.label, values) else unknown_unit(guess.label)
    if text and not (guess.channel == "time" and stated_step(numbers)):
        reason, ask = f"{guess.reason}; {text!r} is no known unit", f"scale in {si} per {text}"
        return replace(guess, scale=1.0, reason=reason, ask=ask, confidence=min(guess.confidence, OPEN))
    span = f"{np.min(values):.4g} .. {np.max(values):.4g}"
    if guess.channel == "time":
        scale, why, ask = time_scale(values, numbers)
        return replace(guess, scale=scale, reason=f"{guess.reason}, {why}", ask=ask)
    scale, why = 1.0, f"{NO_UNIT}, {span}, taken as {si}"
    if counted := _counted(guess, guesses, all_values):
        why = f"{NO_UNIT}, {span}: {counted} holds whole numbers, those of a converter"
        by_reference = _of_reference(guess, units, guesses, all_values) if counted == guess.column else None
        if by_reference:
            why += f"; it follows the reference with a scale of the order of {by_reference:g} m per count"
        reason, ask = f"{guess.reason}; {why}", f"scale in {si} per count"
        return replace(guess, scale=by_reference or 1.0, reason=reason, ask=ask, confidence=OPEN)
    if si == "m":
        # Reference and displacement of one file are in one unit: the larger of them tells it.
        lengths = [all_values[n] for n, g in guesses.items() if g.channel and si_unit(g.channel) == "m"]
        size = max(float(np.abs(v).max()) for v in lengths)
        clock = next((all_values[n] for n, g in guesses.items() if g.channel == "time"), None)
        step = step_of(clock, numbers)
        metres = size < (_SLOW_M if clock is not None and too_slow_for(lengths, step) else _LARGEST_M)
        scale, name = (1.0, "m") if metres else (1e-3, "mm") if size < 50 else (1e-6, "µm")
        why = f"{NO_UNIT}, {span}, of that size taken as {name}"
        shaken = max(acceleration(v, step) for v in lengths)
        while scale > 1e-6 and shaken * scale > MOST_SHAKEN:
            scale, name = (1e-3, "mm") if scale == 1 else (1e-6, "µm")
            why = f"{NO_UNIT}, {span}; no magnet accelerates a rotor so in a larger one: taken as {name}"
    if si == "A":
        # Currents of one file are in one unit, too.
        nameless = [n for n, g in guesses.items() if g.channel and si_unit(g.channel) == "A" and not units[n]]
        if max(float(np.quantile(np.abs(all_values[n]), _MOST_OF_IT)) for n in nameless) > _LARGEST_A:
            scale, why = 1e-3, f"{NO_UNIT}, {span}, of that size taken as mA"
    ask = "; ".join(filter(None, (guess.ask, "unit of this column")))
    return replace(
        guess, scale=scale, reason=f"{guess.reason}; {why}", ask=ask, confidence=min(guess.confidence, LIKELY)
    )


def _of_reference(
    guess: ColumnGuess,
    units: Mapping[str, Unit | None],
    guesses: Mapping[str, ColumnGuess],
    all_values: Mapping[str, np.ndarray],
) -> float | None:
    """The order of a displacement's count (m) by a reference whose unit is stated; None where there is none."""
    wanted = guess.channel.replace("displacement", "reference")
    name = next((n for n, g in guesses.items() if g.channel == wanted != guess.channel), "")
    unit = units.get(name)
    if not unit or unit.si != "m":
        return None
    return order_of_a_count(all_values[guess.column], unit.scale * all_values[name])


def _counted(guess: ColumnGuess, guesses: Mapping[str, ColumnGuess], all_values: Mapping[str, np.ndarray]) -> str:
    """The column of the same unit that is called by its converter and holds whole numbers alone; "" without one."""
    for name, other in guesses.items():
        if (
            other.channel
            and si_unit(other.channel) == si_unit(guess.channel)
            and holds_counts(other.label, all_values[name])
        ):
            return name
    return ""
