"""Controllers from the tables of a rig or campaign TOML."""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, get_args, get_type_hints

from maglev_env.fields import check_known
from maglev_env.loop.axes import AXES
from maglev_env.loop.controller_forms import FORMS, CurrentLoop, Pid
from maglev_env.loop.filtered_pid import LeadLag, LowPass, Notch
from maglev_env.loop.gains import Controller, Controllers, Gains
from maglev_env.loop.linear_controller import LinearController

_PARTS = (Pid, CurrentLoop, Notch, LeadLag, LowPass)  # what a form may consist of


def controllers_from_table(table: Any, where: str) -> Controllers:
    """Controllers from a TOML table.

    Args:
        table: gains, numerator and denominator, or a form with its values; or one such table for each of x and y.
        where: start of messages.

    Raises:
        ValueError: An axis is missing, a key is unknown or missing, or a value is not valid; the message names it.
    """
    if not isinstance(table, Mapping):
        raise ValueError(f"{where} = {table!r} must be a table")
    if any(key in AXES for key in table):
        for key in table:
            check_known((key,), AXES, where)
        if missing := [axis for axis in AXES if axis not in table]:
            raise ValueError(f"{where}: axis {missing[0]} has none; give {where}.x and {where}.y, or one for both")
        for axis in AXES:
            if isinstance(table[axis], Mapping) and any(key in AXES for key in table[axis]):
                raise ValueError(f"{where}.{axis}: x and y again; give one controller")
        x, y = (_controller_from_table(table[axis], f"{where}.{axis}") for axis in AXES)
        return x, y
    return _controller_from_table(table, where)


def _controller_from_table(table: Any, where: str) -> Controller:
    if not isinstance(table, Mapping):
        raise ValueError(f"{where} = {table!r} must be a table")
    if "form" not in table:
        return _from_table(LinearController if {"numerator", "denominator"} & set(table) else Gains, table, where)
    if (form := table["form"]) not in FORMS:
        raise ValueError(f"{where}: form = {form!r}; use one of {', '.join(FORMS)}")
    return _from_table(FORMS[form], {key: value for key, value in table.items() if key != "form"}, where)


def _from_table(cls: type, table: Any, where: str) -> Any:
    if not isinstance(table, Mapping):
        raise ValueError(f"{where} = {table!r} must be a table")
    check_known(table, [f.name for f in fields(cls)], where)
    if missing := [f.name for f in fields(cls) if f.default is MISSING and f.name not in table]:
        raise ValueError(f"{where}: {', '.join(missing)} missing")
    kinds = get_type_hints(cls)
    values: dict[str, Any] = {}
    for key, value in table.items():
        part = next((p for p in _PARTS if p is kinds[key] or p in get_args(kinds[key])), None)
        values[key] = _from_table(part, value, f"{where}.{key}") if part else value
        if isinstance(value, list):
            values[key] = tuple(value)
    try:
        return cls(**values)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
