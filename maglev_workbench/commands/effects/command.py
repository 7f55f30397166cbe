"""`maglev effects`: lists the effects that can be added to a simulated rig."""

from typing import TYPE_CHECKING, Any

import typer

from maglev_workbench.options import JsonOption, friendly

if TYPE_CHECKING:
    from maglev_env.loop.card import EffectCard

SCHEMA = "maglev-effects/1"
app = typer.Typer()


@app.command(epilog="Example: maglev effects --json effects.json")
@friendly
def effects(json_file: JsonOption = None) -> None:
    """List the effects a simulated rig can have, by block, with units, bounds and sources."""
    from importlib.metadata import version

    from rich.table import Table

    from maglev_env.loop.effect import BLOCKS, EFFECTS
    from maglev_workbench.console import console, write_json

    data = {"schema": SCHEMA, "version": version("maglev-workbench")}
    write_json(json_file, data | {"effects": {name: _as_data(card) for name, card in EFFECTS.items()}})
    for block in BLOCKS:
        console.print(f"\n{block}", style="bold")
        table = Table.grid(padding=(0, 1))
        table.add_column(min_width=max(map(len, EFFECTS)))  # the same in every block
        for name, card in EFFECTS.items():
            if card.block == block:
                table.add_row(name, _bounds(name, card), style="bold")
                table.add_row("", f"{card.source}. Identified by {card.identified_by}.")
        console.print(table)


def _bounds(name: str, card: "EffectCard") -> str:
    """The parameters with their bounds; of a free correction the first, because the others are points of its curve."""
    from maglev_env.loop.free.places import NAMES as FREE

    own = [f"{key} {p.bounds}" for key, p in card.parameters.items()]
    return f"{own[0]}, and {len(own) - 1} coefficients (docs/formats.md)" if name in FREE else ", ".join(own)


def _as_data(card: "EffectCard") -> dict[str, Any]:
    """A card for JSON; bounds are multiples of `per` where that is not empty, otherwise in the unit."""
    parameters = {
        key: {"unit": p.unit, "low": p.low, "high": p.high, "per": p.per, "default": _finite(p.default)}
        for key, p in card.parameters.items()
    }
    return {
        "block": card.block,
        "parameters": parameters,
        "identified_by": card.identified_by,
        "source": card.source,
        "needs": list(card.needs),
    }


def _finite(value: float | None) -> float | str | None:
    """JSON has no infinity."""
    return value if value is None or abs(value) < float("inf") else str(value)
