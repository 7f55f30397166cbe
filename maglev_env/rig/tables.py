"""Tables of rig and campaign files as the objects that they describe; controllers have `controller_tables`."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from maglev_env.fields import check_known, increasing_pair, table_as
from maglev_env.loop.effect import EFFECTS, Effects, effect
from maglev_env.rig.excitation import Excitation, check_harmonics
from maglev_env.rig.protocol import Protocol


def effects_from_table(tables: Mapping[str, Any]) -> Effects:
    """[effects], which has one table per effect; parameters that are not given have their defaults.

    Raises:
        ValueError: An effect or a parameter is unknown, or a value is not valid; the message names it.
    """
    found: dict[str, Mapping[str, float]] = {}
    for name, values in tables.items():
        check_known((name,), EFFECTS, "[effects]")
        first = next(iter(EFFECTS[name].parameters))
        if not isinstance(values, Mapping):
            raise ValueError(f"[effects]: {name} = {values!r} must be a table: [effects.{name}] with {first} = ...")
        for key, value in values.items():
            check_known((key,), EFFECTS[name].parameters, f"[effects.{name}]")
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"[effects.{name}]: {key} = {value!r} is not a number")
        try:
            found |= effect(name, **values)
        except ValueError as error:
            raise ValueError(f"[effects.{name}]: {error}") from None
    return found


def protocol_from_table(data: Mapping[str, Any]) -> Protocol:
    """[protocol] with its [[protocol.excitation]].

    Raises:
        ValueError: A key is unknown or missing, or a value is not valid; the message names it.
    """
    data = dict(data)
    tables = data.pop("excitation", [])
    if not isinstance(tables, list):
        raise ValueError(f"[protocol]: excitation = {tables!r} must be tables: [[protocol.excitation]]")
    excitations = tuple(map(excitation_from_table, tables))
    if not excitations:
        raise ValueError("[protocol]: give at least one [[protocol.excitation]]")
    return table_as(Protocol, {"protocol": {**data, "excitations": excitations}}, "protocol")


def excitation_from_table(table: Mapping[str, Any], ignored: tuple[str, ...] = ()) -> Excitation:
    """An Excitation from a TOML table.

    Args:
        table: fields of `Excitation`; `harmonics = [first, last]` may replace the list of all lines between them.
        ignored: keys of the table that belong to something else.

    Raises:
        ValueError: A key is unknown or missing, or a value is not valid.
    """
    if not isinstance(table, Mapping):
        raise ValueError(f"excitation: {table!r} must be a table with kind, at, lines, ...")
    table = {k: v for k, v in table.items() if k not in ignored}
    harmonics = table.pop("harmonics", None)
    if harmonics is not None:
        first, last = increasing_pair(harmonics, "excitation: harmonics")
        check_harmonics((first, last), "harmonics")
        if "lines" in table:
            raise ValueError("excitation: give lines or harmonics, not both")
        table["lines"] = range(int(first), int(last) + 1)
    check_known(table, [f.name for f in fields(Excitation)], "excitation")
    if "kind" not in table:
        raise ValueError("excitation: kind is missing")
    if "band" in table:
        table["band"] = increasing_pair(table["band"], "excitation band")
    if "lines" in table:
        if not isinstance(table["lines"], list | tuple | range):
            raise ValueError(f"excitation: lines = {table['lines']!r}; give a list of harmonic numbers")
        table["lines"] = tuple(table["lines"])
    return Excitation(**table)
