"""What a file calls a column, and what that says of its channel."""

import re
from collections.abc import Iterator, Sequence

import numpy as np

from maglev_env.channels import RECORDED
from maglev_env.recordings.contents import Contents
from maglev_env.recordings.formats.time_stamps import coarse_step
from maglev_env.recordings.guess import behaviour as shown
from maglev_env.recordings.guess.columns.column_guess import ColumnGuess, si_unit
from maglev_env.recordings.guess.evidence import LIKELY, SURE
from maglev_env.recordings.guess.units import Unit, header_unit, known_unit, unit_beside
from maglev_env.recordings.guess.words import Meaning, meaning

_NAMES_BESIDE = ("Name", "name", "Label", "label", "blockName")  # texts of a struct that name its values
_UNITS_BESIDE = ("Unit", "unit", "Units", "units", "XUnit")
_TDMS = re.compile(r"/'.*'/'(.+)'")  # what a TDMS file calls a channel: /'group'/'channel'
_POSITION, _NAMELESS = re.compile(r"\[\d+\]"), re.compile(r"\[.*\]")  # a label that is a place or a unit
_VARIABLE, _TYPE = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+"), re.compile(r"^(f|r|lr)(?=[A-Z])")


def label_of(expression: str, found: Contents) -> tuple[str, Unit | None]:
    """What the file calls a column, and its unit: by a text beside it, else by the last part of its name."""
    texts = found.texts
    among = {*_names_in(found)}
    if channel := _TDMS.fullmatch(expression):
        return header_unit(channel[1], among)
    if header := found.headers.get(expression, ""):
        label, unit = header_unit(header, among)
        # Of a controller's variable, "MAIN.fbAxis.fPosition", the last part without the letter of its type.
        label = _TYPE.sub("", label.rpartition(".")[2]) if _VARIABLE.fullmatch(label) else label
        return label or (expression if _POSITION.fullmatch(expression) else header), unit  # of "[V]" the unit alone
    if listed := _listed(expression, found, _NAMES_BESIDE):
        label, unit = header_unit(_last_part(listed), among)
        return label, unit or unit_beside(label, _listed(expression, found, _UNITS_BESIDE, True))
    above, _, last = expression.rpartition(".")
    beside = next((texts[f"{above}.{key}"] for key in _NAMES_BESIDE if texts.get(f"{above}.{key}", "").strip()), "")
    if beside and meaning(last).channel == "time":  # the block's name is that of the values beside its time
        return last, None
    called = beside or last
    unit = next((u for key in _UNITS_BESIDE if (u := unit_beside(called, texts.get(f"{above}.{key}", "")))), None)
    name = beside.strip().strip('"').replace("\\n", " ") if above and beside else expression
    if above and not beside:
        parts = [p for p in re.split(r"[.\[\]]+", expression) if p and not p.isdigit()]
        telling = [p for p in parts if meaning(header_unit(p)[0]).channel]
        name = telling[-1] if telling else expression
    elif beside:
        unit = unit or header_unit(name.rpartition("/")[2])[1]  # of the port, where the block's name says what it is
        name = _last_part(name)
    label, in_header = header_unit(name, among)
    return label, unit or in_header


def _names_in(found: Contents) -> Iterator[str]:
    """What may be the name of a column of a file."""
    for column in found.columns:
        channel = _TDMS.fullmatch(column)
        yield channel[1] if channel else column
        yield column.rpartition(".")[2]
    yield from found.headers.values()
    yield from found.texts.values()


def _last_part(path: str) -> str:
    """Of a block's path, "Model/Controller/Position", the last part that says something; else the text itself."""
    parts = [p for p in path.replace('"', "").split("/") if p.strip()]
    if "/" not in path or not parts or known_unit(parts[-1]):
        return path
    telling = [p for p in parts if meaning(header_unit(p)[0]).channel]
    return telling[-1] if telling else parts[-1]


def _listed(expression: str, found: Contents, keys: Sequence[str], only: bool = False) -> str:
    """What texts say of a matrix column: in a cell array of as many texts as there are columns, or in one text beside
    it, under one of the `keys`, with as many words between commas; "" where there is none. Lists of units say none, but
    where `only` lists under the keys do."""
    matrix, _, place = expression.removesuffix("]").rpartition("[")
    if not matrix or not place.isdigit():
        return ""
    columns = sum(name.startswith(f"{matrix}[") for name in found.columns)
    lists: dict[str, list[str]] = {}
    for name, text in found.texts.items():
        lists.setdefault(name.rpartition("[")[0], []).append(text)
    above = matrix.rpartition(".")[0]
    joined = [found.texts.get(f"{above}.{key}", "").split(",") for key in keys if above]
    of_keys = {name: name.rpartition(".")[2] in (keys if only else _UNITS_BESIDE) for name in lists}
    every = [texts for name, texts in lists.items() if name and of_keys[name] == only] + joined
    return next((texts[int(place)].strip() for texts in every if len(texts) == columns > 1), "")


def by_name(column: str, label: str, unit: Unit | None, values: np.ndarray, spelled: str = "") -> ColumnGuess:
    """The guess for a column (samples,) by its name and unit; one without a reason where they say nothing.

    Args:
        column: its expression.
        label: what the file calls it.
        unit: that the file states.
        values: (samples,).
        spelled: the name with its axis as x or y, where the file calls it otherwise.
    """
    nameless = _NAMELESS.fullmatch(label) is not None
    said = meaning(spelled or ("" if nameless else label), unit.si if unit else "")
    if said.channel is None and unit and unit.si == "A" and (nameless or label == unit.text):  # by its unit alone
        said = Meaning("current", confidence=LIKELY)
    if not np.isfinite(values).all():
        return ColumnGuess(column, label, "", 1.0, "holds values that are no finite numbers", SURE)
    if said.channel is None or (len(said.word) == 1 and said.channel != "time" and shown.is_time(values)):
        return ColumnGuess(column, label, "", 1.0, "", 0.0)
    if said.channel == "time" and not shown.is_time(values) and coarse_step(values) is None:
        return ColumnGuess(column, label, "", 1.0, f'called "{label}", but does not rise with equal steps', SURE)
    called = f'called "{label}"' + (f" in {unit.text}" if unit else "")
    called += f", an axis that is taken as {said.axis}" if spelled else ""
    if said.channel != "time" and said.channel not in RECORDED:
        return ColumnGuess(column, label, "", 1.0, f"{called}: {said.channel} is not a channel", SURE)
    if unit and unit.si != si_unit(said.channel):
        why = f"{called}: {said.channel} would be in {si_unit(said.channel)}, not in {unit.si}"
        if said.channel in RECORDED and unit.si == "V":  # of a probe, a current clamp: per volt is the user's to state
            suffix = f"_{said.axis}" if said.axis else ""
            return ColumnGuess(column, label, said.channel + suffix, 1.0, f"{called}: a transducer's voltage", LIKELY)
        return ColumnGuess(column, label, "", 1.0, why, LIKELY)
    sure = min(1.0, said.confidence + (0.15 if unit else 0.0))
    suffix = f"_{said.axis}" if said.axis else ""
    return ColumnGuess(column, label, said.channel + suffix, 1.0, called, sure)
