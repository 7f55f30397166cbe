"""A rig as the text of a rig TOML."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any

from maglev_env.loop.gains import as_table
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import PARAMETERS, Rig
from maglev_env.rig.rig_file import SCHEMA

LINE = 100  # characters after which a list of numbers goes on in the next line


def rig_toml(rig: Rig) -> str:
    """A rig as a TOML (schema maglev-rig/1), which `load_rig` reads back unchanged.

    Values that are equal to their defaults are left out.
    """
    top = {"schema": SCHEMA, "name": rig.name, "magnet": rig.magnet} | ({"axes": rig.axes} if rig.axes != 1 else {})
    defaults = {f.name: f.default for f in fields(Rig)}
    parameters = {name: getattr(rig, name) for name in PARAMETERS if getattr(rig, name) != defaults[name]}
    lines = [*_pairs(top), *_table("parameters", parameters)]
    for axis, own in rig.per_axis.items():
        lines += _table(f"axis.{axis}", own)
    lines += _table("cross", _changed(rig.cross))
    if rig.gains is not None:
        gains = as_table(rig.gains)
        tables = {f"gains.{axis}": gains[axis] for axis in gains} if isinstance(rig.gains, tuple) else {"gains": gains}
        lines += [line for name, table in tables.items() for line in _table(name, table)]
    for name in ("noise", "target", "self_sensing"):
        lines += _table(name, _changed(getattr(rig, name)))
    for name in ("bounds", "tolerance", "randomization"):
        lines += _table(name, getattr(rig, name))
    for name, values in rig.effects.items():
        lines += _table(f"effects.{name}", values)
    if rig.protocol is not None:
        lines += ["", "[protocol]", *_pairs({k: v for k, v in _all(rig.protocol).items() if k != "excitations"})]
        for e in rig.protocol.excitations:
            lines += ["", "[[protocol.excitation]]", *_pairs(_excitation(e))]
    return "\n".join(lines) + "\n"


def _excitation(e: Excitation) -> dict[str, Any]:
    table = {"kind": e.kind, **_changed(e)}
    lines = table.pop("lines", ())
    if len(lines) > 1 and lines[-1] - lines[0] == len(lines) - 1:
        return {**table, "harmonics": [lines[0], lines[-1]]}
    return {**table, "lines": lines} if lines else table


def _all(part: Any) -> dict[str, Any]:
    return {f.name: getattr(part, f.name) for f in fields(part)}


def _changed(part: Any) -> dict[str, Any]:
    """Fields of a dataclass that differ from their defaults."""
    return {f.name: v for f in fields(part) if f.default is not MISSING and (v := getattr(part, f.name)) != f.default}


def _table(name: str, values: Mapping[str, Any]) -> list[str]:
    return ["", f"[{name}]", *_pairs(values)] if values else []


def _pairs(values: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {_toml(value)}" for key, value in values.items()]


def _toml(value: Any) -> str:
    """A text, a number, a sequence of numbers, or a mapping of them: a controller's own parts."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return f"{{ {', '.join(_pairs(value))} }}" if value else "{}"
    if isinstance(value, Sequence):
        rows, row = [], ""
        for text in map(_toml, value):
            if row and len(row) + len(text) > LINE:
                rows, row = [*rows, row], ""
            row += f"{text}, "
        return f"[{row.rstrip(', ')}]" if not rows else "[\n    " + "\n    ".join([*rows, row]).rstrip() + "\n]"
    return repr(int(value)) if isinstance(value, int) else repr(float(value))
