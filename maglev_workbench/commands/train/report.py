"""The terminal's table of a trained policy."""

from typing import Any

from rich.table import Table

from estimation.normal import NORMAL_95


def held_out_table(found: dict[str, Any], rigs: int) -> Table:
    """Mean score with its 95 % interval by number of experiments, on held-out rigs."""
    grid = Table(title=f"{rigs} rigs not met in training; {found['touchdowns']} touchdowns")
    for name in ("experiments", "mean score", "95 %"):
        grid.add_column(name, justify="right")
    for n, score, se in zip(found["after"], found["score"], found["se"], strict=True):
        grid.add_row(str(n), f"{score:.4f}", f"± {NORMAL_95 * se:.4f}")
    return grid
