"""Which column of a file is which channel: by names, by units, and by what the values do."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from maglev_env.channels import RECORDED, unit_of
from maglev_env.recordings.contents import Contents
from maglev_env.recordings.guess import behaviour as shown
from maglev_env.recordings.guess.counts import holds_counts, order_of_a_count
from maglev_env.recordings.guess.evidence import LIKELY, OPEN, SURE
from maglev_env.recordings.guess.rate import time_scale
from maglev_env.recordings.guess.sizes import MOST_SHAKEN, acceleration, step_of, too_slow_for
from maglev_env.recordings.guess.units import Unit, header_unit, known_unit
from maglev_env.recordings.guess.words import Meaning, meaning

_NAMES_BESIDE = ("Name", "name", "Label", "label", "blockName")  # texts of a struct that name its values
_UNITS_BESIDE = ("Unit", "unit", "Units", "units", "XUnit")
_TDMS = re.compile(r"/'.*'/'(.+)'")  # what a TDMS file calls a channel: /'group'/'channel'
_VARIABLE, _TYPE = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+"), re.compile(r"^(f|r|lr)(?=[A-Z])")
# Sizes up to which the values of a channel without a unit are likely to be in SI; beyond them it is in a smaller unit.
_LARGEST_M = 0.05
_SLOW_M = 0.3  # the same of distances that a slow controller could not hold if they were in mm
_LARGEST_A, _MOST_OF_IT = 60.0, 0.99  # the second: share of a current's values, since single ones may be spikes
NO_UNIT = "no unit"  # begins the evidence for a scale by the size of the values
_NOT_CURRENT = 3.0  # times the size of the current beyond which a "command" is a voltage


@dataclass(frozen=True)
class ColumnGuess:
    """What one column is taken for.

    Args:
        column: expression, as `Columns.column` takes it.
        label: what the file calls it.
        channel: channel of a campaign; "" where the column is not used.
        scale: SI value of one of the file's units.
        reason: the evidence.
        confidence: from 0 to 1.
        ask: what the user should state; empty where nothing is open.
        resting: whether it is not used for the sole reason that it never changes in this file.
        offset: SI value at which the column reads 0.
        total: whether a current includes the bias of the rig.
        stated: whether its scale is stated by the user.
    """

    column: str
    label: str
    channel: str
    scale: float
    reason: str
    confidence: float
    ask: str = ""
    resting: bool = False
    offset: float = 0.0
    total: bool = False
    stated: bool = False

    @property
    def source(self) -> dict[str, Any]:
        """Its table in [recording.channels]."""
        stated = {"scale": (self.scale, 1.0), "offset": (self.offset, 0.0), "total": (self.total, False)}
        return {"from": self.column, **{key: value for key, (value, usual) in stated.items() if value != usual}}


def with_scale(column: ColumnGuess, scale: float) -> ColumnGuess:
    """The column in another unit or direction: it is 0 at the same reading."""
    return replace(column, scale=scale, offset=column.offset * scale / column.scale)


def guess_columns(found: Contents) -> tuple[ColumnGuess, ...]:
    """A guess for every column of a file, in the file's order.

    Args:
        found: what is in the file.

    Returns:
        No channel is given to two columns. Columns along x and y end in _x and _y where both displacements are there.
    """
    labels = {name: _label(name, found) for name in found.columns}
    values = {name: v[: shown.MOST] for name, v in found.columns.items()}
    units = {name: unit for name, (_, unit) in labels.items()}
    guesses = {name: _by_name(name, label, unit, values[name]) for name, (label, unit) in labels.items()}
    named = dict(guesses)
    guesses = _one_each(guesses)
    guesses = _voltage(_not_a_length(guesses, units, values), units, values)
    guesses = _freed(guesses, named)
    guesses = _by_behaviour(guesses, values, units)
    guesses = {n: _resting(g, values[n]) for n, g in guesses.items()}
    return tuple(_scaled(g, units, values[name], guesses, values, found.numbers) for name, g in guesses.items())


def _label(expression: str, found: Contents) -> tuple[str, Unit | None]:
    """What the file calls a column, and its unit: by a text beside it, else by the last part of its name."""
    texts = found.texts
    if channel := _TDMS.fullmatch(expression):
        return header_unit(channel[1])
    if header := found.headers.get(expression, ""):
        label, unit = header_unit(header)
        # Of a controller's variable, "MAIN.fbAxis.fPosition", the last part without the letter of its type.
        label = _TYPE.sub("", label.rpartition(".")[2]) if _VARIABLE.fullmatch(label) else label
        return label or expression, unit
    if listed := _listed(expression, found):
        return header_unit(_last_part(listed))
    above, _, last = expression.rpartition(".")
    beside = next((texts[f"{above}.{key}"] for key in _NAMES_BESIDE if texts.get(f"{above}.{key}", "").strip()), "")
    if beside and meaning(last).channel == "time":  # the block's name is that of the values beside its time
        return last, None
    unit = next((u for key in _UNITS_BESIDE if (u := known_unit(texts.get(f"{above}.{key}", "")))), None)
    name = beside.strip().strip('"').replace("\\n", " ") if above and beside else expression
    if above and not beside:
        parts = [p for p in re.split(r"[.\[\]]+", expression) if p and not p.isdigit()]
        telling = [p for p in parts if meaning(header_unit(p)[0]).channel]
        name = telling[-1] if telling else expression
    elif beside:
        unit = unit or header_unit(name.rpartition("/")[2])[1]  # of the port, where the block's name says what it is
        name = _last_part(name)
    label, in_header = header_unit(name)
    return label, unit or in_header


def _last_part(path: str) -> str:
    """Of a block's path, "Model/Controller/Position", the last part that says something; else the text itself."""
    parts = [p for p in path.replace('"', "").split("/") if p.strip()]
    if "/" not in path or not parts or known_unit(parts[-1]):
        return path
    telling = [p for p in parts if meaning(header_unit(p)[0]).channel]
    return telling[-1] if telling else parts[-1]


def _listed(expression: str, found: Contents) -> str:
    """The name of a matrix column: in a cell array of as many texts as there are columns, or in one text beside it with
    as many names between commas; "" where there is none."""
    matrix, _, place = expression.removesuffix("]").rpartition("[")
    if not matrix or not place.isdigit():
        return ""
    columns = sum(name.startswith(f"{matrix}[") for name in found.columns)
    lists: dict[str, list[str]] = {}
    for name, text in found.texts.items():
        lists.setdefault(name.rpartition("[")[0], []).append(text)
    above = matrix.rpartition(".")[0]
    joined = [found.texts.get(f"{above}.{key}", "").split(",") for key in _NAMES_BESIDE if above]
    every = [texts for name, texts in lists.items() if name] + joined
    return next((texts[int(place)].strip() for texts in every if len(texts) == columns > 1), "")


def _by_name(column: str, label: str, unit: Unit | None, values: np.ndarray) -> ColumnGuess:
    said = meaning("" if re.fullmatch(r"\[\d+\]", label) else label, unit.si if unit else "")
    if said.channel is None and unit and unit.si == "A" and label == unit.text:  # called by its unit alone
        said = Meaning("current", confidence=LIKELY)
    if not np.isfinite(values).all():
        return ColumnGuess(column, label, "", 1.0, "holds values that are no finite numbers", SURE)
    if said.channel is None or (len(said.word) == 1 and said.channel != "time" and shown.is_time(values)):
        return ColumnGuess(column, label, "", 1.0, "", 0.0)
    if said.channel == "time" and not shown.is_time(values):
        return ColumnGuess(column, label, "", 1.0, f'called "{label}", but does not rise with equal steps', SURE)
    called = f'called "{label}"' + (f" in {unit.text}" if unit else "")
    if said.channel != "time" and said.channel not in RECORDED:
        return ColumnGuess(column, label, "", 1.0, f"{called}: {said.channel} is not a channel", SURE)
    if unit and unit.si != _unit(said.channel):
        why = f"{called}: {said.channel} would be in {_unit(said.channel)}, not in {unit.si}"
        if said.channel in RECORDED and unit.si == "V":  # of a probe, a current clamp: per volt is the user's to state
            suffix = f"_{said.axis}" if said.axis else ""
            return ColumnGuess(column, label, said.channel + suffix, 1.0, f"{called}: a transducer's voltage", LIKELY)
        return ColumnGuess(column, label, "", 1.0, why, LIKELY)
    sure = min(1.0, said.confidence + (0.15 if unit else 0.0))
    suffix = f"_{said.axis}" if said.axis else ""
    return ColumnGuess(column, label, said.channel + suffix, 1.0, called, sure)


def _unit(channel: str) -> str:
    return "s" if channel == "time" else unit_of(channel)


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


def _resting(guess: ColumnGuess, values: np.ndarray) -> ColumnGuess:
    """A constant column is no reading; a constant reference is one."""
    if not guess.channel.startswith(("gap_estimate", "voltage", "injection", "speed")) or not shown.is_constant(values):
        return guess
    return replace(guess, channel="", reason=f"{guess.reason}, but {values[0]:g} in every sample", resting=True)


def _by_behaviour(
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


def _scaled(
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
    si, unit = _unit(guess.channel), units[guess.column]
    if unit and unit.si == si:
        return replace(guess, scale=unit.scale)
    if unit:
        ask = f"scale in {si} per {unit.text}"
        return replace(guess, ask=ask, confidence=min(guess.confidence, OPEN))
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
        lengths = [all_values[n] for n, g in guesses.items() if g.channel and _unit(g.channel) == "m"]
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
        nameless = [n for n, g in guesses.items() if g.channel and _unit(g.channel) == "A" and not units[n]]
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
            and _unit(other.channel) == _unit(guess.channel)
            and holds_counts(other.label, all_values[name])
        ):
            return name
    return ""
