"""What hangs below a single magnet: its current includes the bias, and a measured gap grows away from the magnet."""

from dataclasses import replace
from typing import TYPE_CHECKING

from maglev_env.recordings.guess.behaviour import correlation
from maglev_env.recordings.guess.columns import ColumnGuess
from maglev_env.recordings.guess.evidence import LIKELY
from maglev_env.recordings.guess.recording import RecordingGuess, other_way_round
from maglev_env.recordings.guess.words import is_distance

if TYPE_CHECKING:
    import xarray as xr

_FOLLOWS = 0.5  # least correlation of current and displacement that shows a direction
_POSITIONS = ("displacement", "reference", "gap_estimate")
_TOTAL = "total = true, once the rig is named: this current includes the one that carries the weight"
_OFFSET = "offset = the gap in rig.toml (m), so that displacement is 0 there and positive towards the magnet"


def facing_the_magnet(guess: RecordingGuess, dataset: "xr.Dataset") -> RecordingGuess:
    """The guess of a suspended rotor with the direction of its positions, and what its current needs.

    Nothing but the magnet and the weight acts on it, so ki i = -(m w^2 + ks) y at every frequency: the current falls as
    the rotor moves towards the magnet, and rises with a distance from it. Where it moves too little to show that, the
    sign of its controller tells, or else what the column is called.

    Args:
        guess: of one file.
        dataset: the file, read by it.
    """
    effort = next((name for name in ("current", "command", "voltage") if name in dataset), None)
    hangs = guess.rotor.value == "suspended" and guess.rotor.confidence >= LIKELY
    if "displacement" not in guess.channels or not hangs or effort is None:
        return guess
    follows = correlation(dataset["displacement"].values, dataset[effort].values)
    why = ""
    if follows > _FOLLOWS:
        why = f"the {effort} rises with it (correlation {follows:.2f})"
    elif follows > -_FOLLOWS and guess.gains and guess.gains["kp"] < 0:
        why = "its controller's gain is negative, and yet it levitates"
    elif follows > -_FOLLOWS and is_distance(guess.channels["displacement"].label):
        why = "it is called so"
    columns = tuple(
        _asking(c, _TOTAL) if c.channel in ("current", "command")
        else _reversed(c, why) if c.channel in _POSITIONS and why
        else c
        for c in guess.columns
    )  # fmt: skip
    turned = replace(guess, columns=columns)
    return other_way_round(turned) if why else turned


def _asking(column: ColumnGuess, ask: str) -> ColumnGuess:
    return replace(column, ask=f"{column.ask}; {ask}" if column.ask else ask)


def _reversed(column: ColumnGuess, why: str) -> ColumnGuess:
    reason = f"{column.reason}; a distance from the magnet: {why}"
    return _asking(replace(column, scale=-column.scale, reason=reason), _OFFSET)
