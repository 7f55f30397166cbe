"""What the user states of columns: their scale, and the reading at which they are 0."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from maglev_env.recordings.guess.columns.column_guess import ColumnGuess, with_scale
from maglev_env.recordings.guess.evidence import STATED

SAME_DIRECTION = "scale > 0, if it counts in the other direction than the displacement"
_BESIDE = {
    f"displacement{axis}": (f"reference{axis}", f"gap_estimate{axis}") for axis in ("", "_x", "_y")
}  # positions that count from where their displacement does


def with_stated(
    columns: Sequence[ColumnGuess], scales: Mapping[str, float], zeros: Mapping[str, float]
) -> tuple[ColumnGuess, ...]:
    """The columns of a file with what the user states of some of them, by what the file calls them.

    Args:
        columns: guesses.
        scales: label or expression -> SI value of one of the file's units.
        zeros: label or expression -> reading of the file at which the SI value is 0.

    Returns:
        Of a displacement whose scale is stated below 0, the reference and the estimate count in its direction, too,
        where nothing is stated of them.
    """
    stated = tuple(_stated(c, _of(c, scales), _of(c, zeros)) for c in columns)
    turned = {c.channel for c in stated if c.stated and c.scale < 0 and c.channel in _BESIDE}
    return tuple(_turned(c) if _moved(c) in turned and not c.stated and c.scale > 0 else c for c in stated)


def _moved(column: ColumnGuess) -> str:
    """The displacement beside which a position counts; "" of other channels."""
    return next((m for m, beside in _BESIDE.items() if column.channel in beside), "")


def _turned(column: ColumnGuess) -> ColumnGuess:
    """A position that counts as the displacement does, whose scale is stated below 0."""
    ask = "; ".join(filter(None, (column.ask, SAME_DIRECTION)))
    reason = f"{column.reason}; scale < 0 as that of the displacement is stated"
    return replace(with_scale(column, -column.scale), reason=reason, ask=ask)


def _of(column: ColumnGuess, values: Mapping[str, float]) -> float | None:
    return next((values[name] for name in (column.label, column.column) if name in values), None)


def _stated(column: ColumnGuess, scale: float | None, zero: float | None) -> ColumnGuess:
    if not column.channel or (scale is None and zero is None):
        return column
    known = column if scale is None else with_scale(column, scale)
    kept = [part for part in column.ask.split("; ") if part and not part.startswith(("scale in", "unit of"))]
    said = [f"scale {scale:g} stated"] if scale is not None else []
    said += [f"0 at a reading of {zero:g}, stated"] if zero is not None else []
    return replace(
        known, offset=known.offset if zero is None else -known.scale * zero, stated=scale is not None,
        reason="; ".join([column.reason, *said]), ask="; ".join(kept) if scale is not None else column.ask,
        confidence=STATED if scale is not None else column.confidence,
    )  # fmt: skip
