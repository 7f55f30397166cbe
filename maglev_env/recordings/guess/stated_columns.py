"""What the user states of columns: their scale, and the reading at which they are 0."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from maglev_env.recordings.guess.columns import ColumnGuess
from maglev_env.recordings.guess.evidence import STATED


def with_stated(
    columns: Sequence[ColumnGuess], scales: Mapping[str, float], zeros: Mapping[str, float]
) -> tuple[ColumnGuess, ...]:
    """The columns of a file with what the user states of some of them, by what the file calls them.

    Args:
        columns: guesses.
        scales: label or expression -> SI value of one of the file's units.
        zeros: label or expression -> reading of the file at which the SI value is 0.
    """
    return tuple(_stated(c, _of(c, scales), _of(c, zeros)) for c in columns)


def _of(column: ColumnGuess, values: Mapping[str, float]) -> float | None:
    return next((values[name] for name in (column.label, column.column) if name in values), None)


def _stated(column: ColumnGuess, scale: float | None, zero: float | None) -> ColumnGuess:
    if not column.channel or (scale is None and zero is None):
        return column
    size = column.scale if scale is None else scale
    kept = [part for part in column.ask.split("; ") if part and not part.startswith(("scale in", "unit of"))]
    said = [f"scale {scale:g} stated"] if scale is not None else []
    said += [f"0 at a reading of {zero:g}, stated"] if zero is not None else []
    return replace(
        column, scale=size, offset=column.offset if zero is None else -size * zero, stated=scale is not None,
        reason="; ".join([column.reason, *said]), ask="; ".join(kept) if scale is not None else column.ask,
        confidence=STATED if scale is not None else column.confidence,
    )  # fmt: skip
