"""The card of a gain: unit, physical ends, the range in which it is tuned, and how pages show it.

Every number of a controller that may be swept or tuned has one, as metadata of its dataclass field; so the fields of a
controller are its parameter table.
"""

from collections.abc import Iterator
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from math import inf
from typing import Any, get_args, get_type_hints

from maglev_env.fields import check_range


@dataclass(frozen=True)
class GainCard:
    """What is known of a gain before it has a value.

    Args:
        unit: SI.
        tuned: default range of tuning (low, high): factors of the preset value, or values with `absolute`.
        absolute: whether `tuned` holds values.
        first: whether it is tuned unless the user chooses otherwise.
        low, high: physical ends.
        shown: factor from SI and unit on pages; None: as it is.
    """

    unit: str
    tuned: tuple[float, float]
    absolute: bool = False
    first: bool = True
    low: float = -inf
    high: float = inf
    shown: tuple[float, str] | None = None

    @property
    def on_pages(self) -> tuple[float, str]:
        """Factor from SI and unit in which pages show it."""
        return self.shown or (1.0, self.unit)

    def range(self, value: float) -> tuple[float, float]:
        """Default range of tuning around a preset value."""
        low, high = self.tuned
        return (low, high) if self.absolute else (low * value, high * value)


def gain(card: GainCard, default: Any = MISSING) -> Any:
    """A dataclass field that holds a gain."""
    return field(metadata={"card": card}) if default is MISSING else field(default=default, metadata={"card": card})


# Ranges around gains that levitate: mostly stable and well damped on rigs with every kind of magnet.
KP = GainCard("A/m", (0.6, 2.5), shown=(1e-3, "A/mm"))
KI = GainCard("A/(m s)", (0.1, 10.0), shown=(1e-3, "A/(mm s)"))
LEAK = GainCard("A/m", (0.1, 10.0), shown=(1e-3, "A/mm"))  # of a low-pass in the integrator's place
KD = GainCard("A s/m", (0.3, 3.0))
TIME_CONSTANT = GainCard("s", (0.3, 3.0), first=False)


def cards(of: type) -> dict[str, GainCard]:
    """The parameter table of a class of controllers: cards by name, those of a part behind its name and `_`."""
    kinds, found = get_type_hints(of), {}
    for f in fields(of):
        if "card" in f.metadata:
            found[f.name] = f.metadata["card"]
        for part in (kinds[f.name], *get_args(kinds[f.name])):
            if is_dataclass(part) and isinstance(part, type):
                found |= {f"{f.name}_{name}": card for name, card in cards(part).items()}
    return found


def stated_gains(controller: Any) -> Iterator[tuple[str, float, GainCard]]:
    """Name, value and card of each gain that a controller has, in the order of its fields."""
    for f in fields(controller):
        value = getattr(controller, f.name)
        if "card" in f.metadata:
            yield f.name, value, f.metadata["card"]
        elif is_dataclass(value):
            yield from ((f"{f.name}_{name}", own, card) for name, own, card in stated_gains(value))


def check_gains(part: Any, where: str) -> None:
    """Check the gains of a controller or of a part of it; its own parts have checked theirs.

    Raises:
        ValueError: One is not a finite number, or outside its physical ends; the message names it.
    """
    for f in fields(part):
        if "card" in f.metadata:
            check_range(f"{where}: {f.name}", getattr(part, f.name), vars(f.metadata["card"]))
