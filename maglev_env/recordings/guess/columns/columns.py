"""Which column of a file is which channel: by names, by units, and by what the values do."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from maglev_env.recordings.contents import Contents
from maglev_env.recordings.guess import behaviour as shown
from maglev_env.recordings.guess.columns.by_values import by_behaviour
from maglev_env.recordings.guess.columns.clocks import at_one_clock, called_time
from maglev_env.recordings.guess.columns.column_guess import ColumnGuess
from maglev_env.recordings.guess.columns.naming import by_name, label_of
from maglev_env.recordings.guess.columns.opposed import opposed
from maglev_env.recordings.guess.columns.scaling import scaled
from maglev_env.recordings.guess.columns.two_axes import spelled_as_xy
from maglev_env.recordings.guess.evidence import LIKELY, OPEN, STATED
from maglev_env.recordings.guess.units import Unit

_NOT_CURRENT = 3.0  # times the size of the current beyond which a "command" is a voltage
ASK_SPEED = "speed_rpm of the recording, because this column states no known unit"
UNUSED = "unused"  # stated of a column that is no channel


def guess_columns(found: Contents, channels: Mapping[str, str] | None = None) -> tuple[ColumnGuess, ...]:
    """A guess for every column of a file, in the file's order.

    Args:
        found: what is in the file.
        channels: what the user states of columns, by what the file calls them or their expression: channel, or UNUSED.

    Returns:
        No channel is given to two columns. Columns along x and y end in _x and _y where both displacements are there.
    """
    labels = {name: label_of(name, found) for name in found.columns}
    values = {name: v[: shown.MOST] for name, v in found.columns.items()}
    units = {name: unit for name, (_, unit) in labels.items()}
    axes = spelled_as_xy(labels)
    guesses = {
        name: by_name(name, label, unit, values[name], axes.get(name, "")) for name, (label, unit) in labels.items()
    }
    fixed = _as_stated(guesses, channels or {})
    guesses |= fixed
    named = dict(guesses)
    guesses = _one_each(guesses)
    guesses = _voltage(_not_a_length(guesses, units, values), units, values)
    guesses = opposed(_freed(guesses, named), named, units, values)
    guesses = by_behaviour(guesses, values, units)
    stated = {g.channel for g in fixed.values()}
    free = {n: replace(g, channel="") if g.channel in stated else g for n, g in guesses.items()}
    read = {n: v if found.bridged is None else v[~found.bridged[: v.size]] for n, v in values.items()}
    times = {
        n: g for n, g in named.items() if g.channel == "time" or (called_time(*labels[n]) and shown.is_time(read[n]))
    }
    free = at_one_clock(free | fixed, times, units, read, found.numbers)
    guesses = {n: _resting(g, units[n], values[n]) for n, g in free.items()} | fixed
    return tuple(scaled(g, units, values[name], guesses, values, found.numbers) for name, g in guesses.items())


def _as_stated(guesses: Mapping[str, ColumnGuess], channels: Mapping[str, str]) -> dict[str, ColumnGuess]:
    """The columns of which the user states what they are.

    Raises:
        ValueError: a channel is stated of two columns of the file.
    """
    told = {n: channels.get(g.label, channels.get(n)) for n, g in guesses.items()}
    for channel, count in Counter(told.values()).items():
        if channel not in (None, UNUSED) and count > 1:
            both = ", ".join(guesses[n].label for n, own in told.items() if own == channel)
            raise ValueError(
                f"{channel} is stated of {count} columns ({both}); state one of them, and of others unused"
            )
    return {
        n: replace(
            g, channel="" if told[n] == UNUSED else told[n], reason=f"{told[n]}: stated", confidence=STATED, ask=""
        )
        for n, g in guesses.items()
        if told[n] is not None
    }


def _one_each(guesses: dict[str, ColumnGuess]) -> dict[str, ColumnGuess]:
    """Every channel to one column; axes only where both have a displacement."""
    plain = {n: g for n, g in guesses.items() if g.channel == "displacement"}
    named = {header: n for n in plain if (header := guesses[n].label.lower()) in ("x", "y")}
    if len(plain) == 2 and set(named) == {"x", "y"}:  # two columns called x and y are two axes
        for header, n in named.items():
            guesses[n] = replace(guesses[n], channel=f"displacement_{header}")
    planar = {"displacement_x", "displacement_y"} <= {g.channel for g in guesses.values()}
    if not planar:
        guesses = {n: replace(g, channel=g.channel.removesuffix("_x").removesuffix("_y")) for n, g in guesses.items()}
        guesses = {n: replace(g, channel=g.channel.removesuffix("_z")) for n, g in guesses.items()}
    best: dict[str, str] = {}
    for n, g in guesses.items():
        if g.channel and (g.channel not in best or g.confidence > guesses[best[g.channel]].confidence):
            best[g.channel] = n
    return {n: g if best.get(g.channel, n) == n else _second(g, guesses[best[g.channel]]) for n, g in guesses.items()}


def _second(guess: ColumnGuess, first: ColumnGuess) -> ColumnGuess:
    why = f'{guess.reason}: also {guess.channel}, but "{first.label}" is taken'
    # Channels may have equal times of their own, so a second time is no question.
    equal = guess.confidence >= first.confidence and guess.channel != "time"
    ask = f"which column is the {guess.channel}" if equal else ""
    return replace(guess, channel="", reason=why, ask=ask, confidence=OPEN if ask else LIKELY)


def _not_a_length(
    guesses: dict[str, ColumnGuess], units: Mapping[str, Unit | None], values: Mapping[str, np.ndarray]
) -> dict[str, ColumnGuess]:
    """A set point without a unit that moves as the current is the command."""
    by_channel = {g.channel: n for n, g in guesses.items() if g.channel}
    if not {"reference", "current"} <= by_channel.keys() or "command" in by_channel:
        return guesses
    wanted, current = by_channel["reference"], by_channel["current"]
    if units[wanted] or not (close := shown.alike(values[wanted], values[current])):
        return guesses
    why = f"{guesses[wanted].reason}, moves as {current} (correlation {close:.3f})"
    return guesses | {wanted: replace(guesses[wanted], channel="command", reason=why)}


def _voltage(
    guesses: dict[str, ColumnGuess], units: Mapping[str, Unit | None], values: Mapping[str, np.ndarray]
) -> dict[str, ColumnGuess]:
    """A command without a unit whose size is not that of the current is the amplifier's voltage."""
    by_channel = {g.channel: n for n, g in guesses.items() if g.channel}
    if not {"command", "current"} <= by_channel.keys() or "voltage" in by_channel:
        return guesses
    command, current = by_channel["command"], by_channel["current"]
    sizes = [float(np.sqrt(np.mean(values[n] ** 2))) for n in (command, current)]
    if units[command] or shown.alike(values[command], values[current]) or not sizes[0] > _NOT_CURRENT * sizes[1] > 0:
        return guesses
    why = f"{guesses[command].reason}, {sizes[0] / sizes[1]:.3g} times the size of {current}, and does not move as it"
    ask = "whether this column is the voltage at the coil"
    taken = replace(guesses[command], channel="voltage", reason=why, confidence=LIKELY, ask=ask)
    return guesses | {command: taken}


def _freed(guesses: dict[str, ColumnGuess], named: Mapping[str, ColumnGuess]) -> dict[str, ColumnGuess]:
    """A column that is called a command, too, is the command where the one that was taken is another quantity."""
    if any(g.channel == "command" for g in guesses.values()):
        return guesses
    free = next((n for n, g in named.items() if g.channel == "command" and not guesses[n].channel), None)
    return guesses if free is None else guesses | {free: named[free]}


def _resting(guess: ColumnGuess, unit: Unit | None, values: np.ndarray) -> ColumnGuess:
    """A constant column is no reading; a constant reference is one."""
    if not guess.channel.startswith(("gap_estimate", "voltage", "injection", "speed")) or not shown.is_constant(values):
        return guess
    reason, scale = f"{guess.reason}, but {values[0]:g} in every sample", unit.scale if unit else guess.scale
    guess = replace(guess, channel="", reason=reason, resting=guess.channel, scale=scale)
    if guess.resting == "speed" and unit is None and values[0] != 0:  # rad/s, 1/min or 1/s
        return replace(guess, ask=ASK_SPEED, confidence=OPEN)
    return guess
