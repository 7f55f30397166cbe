"""What a file states of the transducer behind a column: its sensitivity, such as 8000 V/m."""

from collections.abc import Mapping

from maglev_env.recordings.guess.units import Unit, known_unit

_CALLED = ("sensitivity", "empfindlichkeit", "sensibilite", "sensibilidad")


def sensitivity_of(column: str, si: str, unit: Unit, numbers: Mapping[str, float]) -> tuple[float, str] | None:
    """The scale of a column that a transducer's sensitivity gives, and the evidence; None without one.

    Args:
        column: its expression.
        si: SI unit of its channel.
        unit: that of its numbers.
        numbers: single numbers of the file; "ch0.sensitivity [mV/N]" is that of the column ch0.

    Returns:
        SI value of one of the column's units; None also where the sensitivity has no unit, or another one.
    """
    for name, value in numbers.items():
        above, _, last = name.partition(f"{column}.")
        called, bracket, text = last.partition(" [")
        if above or not bracket or called.lower() not in _CALLED or not value:
            continue
        of_reading, _, of_quantity = text.rstrip("]").partition("/")
        reading, quantity = known_unit(of_reading.strip()), known_unit(of_quantity.strip())
        if reading and quantity and reading.si == unit.si and quantity.si == si:
            scale = float(f"{unit.scale * quantity.scale / (reading.scale * value):.12g}")
            return scale, f"its sensitivity is stated: {value:g} {text.rstrip(']')}"
    return None
