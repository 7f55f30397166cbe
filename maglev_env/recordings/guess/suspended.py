"""What hangs below a single magnet: its current includes the bias, and a measured gap grows away from the magnet."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.channels import EFFORTS
from maglev_env.recordings.contents import contents
from maglev_env.recordings.derived import tells_current
from maglev_env.recordings.files import read_columns
from maglev_env.recordings.guess.behaviour import correlation
from maglev_env.recordings.guess.columns.column_guess import ColumnGuess, with_scale
from maglev_env.recordings.guess.columns.stated_columns import SAME_DIRECTION
from maglev_env.recordings.guess.evidence import LIKELY, STATED
from maglev_env.recordings.guess.recording import RecordingGuess, other_way_round
from maglev_env.recordings.guess.words import is_distance
from maglev_env.rig.rig import Rig

if TYPE_CHECKING:
    import xarray as xr

_FOLLOWS = 0.5  # least correlation of current and displacement that shows a direction
_MEANS, _LEAST = (4, 16, 64), 40  # samples that are averaged before they are compared, and means that show anything
_POSITIONS = ("displacement", "reference", "gap_estimate")
_SLOW = 0.5  # share of a set point's size that its means over the most samples hold, from which a loop follows it
TOTAL = "total = true, once the rig is named: this current includes the one that carries the weight"
DIRECTION = "scale < 0, if it is a distance that grows away from the magnet (nothing here shows it)"
BUT_STATED = "scale < 0, if it is a distance that grows away from the magnet, as it seems"
KNOWN_ZERO = "offset_tolerance, how surely its zero is known: then means at rest and the weight tell the magnet's force"
OTHER_WAY = "it rises where the displacement falls"
CENTRE = "offset, so that displacement is 0 at the centre between the stops"
_APART = 2.0  # ranges of a motion by which its mean is away from 0
AT_THE_GAP = "offset = the gap in rig.toml (m), so that displacement is 0 there and positive towards the magnet"


def facing_the_magnet(guess: RecordingGuess, dataset: "xr.Dataset") -> RecordingGuess:
    """The guess of a suspended rotor with the direction of its positions, and what its current needs.

    Nothing but the magnet and the weight acts on it, so ki i = -(m w^2 + ks) y at every frequency: the current falls as
    the rotor moves towards the magnet, and rises with a distance from it. Noise of either hides that at high
    frequencies first. Where it moves too little to show it at all, the sign of its controller tells, or else what the
    column is called; where that says nothing either, it is asked for. What the user states stands. A permanent magnet
    may carry the weight (zero-power control), so a distance that the current follows is turned without a mean current.

    Args:
        guess: of one file.
        dataset: the file, read by it.
    """
    effort = next((name for name in EFFORTS if name in dataset), None)
    if "displacement" not in guess.channels or guess.rotor.value is None or effort is None:
        return guess
    bears = guess.rotor.value == "suspended"  # the current carries the weight
    moved, known = guess.channels["displacement"], guess.gains or guess.form
    turned = moved.stated and moved.scale < 0  # by the user
    follows = _follows(dataset["displacement"].values, dataset[effort].values) * (-1 if turned else 1)
    # A large excitation may turn the current round, which then shows a weight less clearly than a distance is told.
    distance = is_distance(moved.label)
    if (not bears or guess.rotor.confidence < LIKELY) and not (distance and follows > _FOLLOWS):
        return guess
    why = "" if turned else _why(effort, follows, known, distance)
    asked = follows > -_FOLLOWS and not (why or turned or known or moved.stated)

    flips = bool(why) and not moved.stated
    positions = {n: dataset[n].values for n in _POSITIONS if n in dataset}
    other_way = {n for n, read in positions.items() if _other_way(read, positions["displacement"])}

    def faced(column: ColumnGuess) -> ColumnGuess:
        if column.channel in EFFORTS:
            return _asking(column, TOTAL) if bears else column
        if column.channel not in _POSITIONS:
            return column
        if column.channel in other_way and not column.stated:
            left = "; ".join(part for part in column.ask.split("; ") if part != SAME_DIRECTION)
            shown = replace(column, reason=f"{column.reason}; {'' if flips else 'but '}{OTHER_WAY}", ask=left)
            return shown if flips else with_scale(shown, -column.scale)
        if flips and not column.stated:
            return _reversed(column, why)
        if why and column.scale > 0:
            return _asking(column, f"{BUT_STATED} ({why})")
        if (why or turned) and column.scale < 0 and not column.offset:
            return _asking(column, AT_THE_GAP)
        return _asking(column, DIRECTION) if asked and column is moved else column

    faced_all = replace(guess, columns=tuple(faced(c) for c in guess.columns))
    return other_way_round(faced_all) if flips else faced_all


def _why(effort: str, follows: float, known: Mapping[str, Any] | None, distance: bool) -> str:
    """What shows that a displacement grows away from the magnet; "" where nothing does.

    What repels its rotor moves with its current, and is stable; so the sign of a controller that is known decides.
    """
    if known and (gain := known.get("kp", known.get("displacement", 0.0))):
        return "its controller's gain is negative, and yet it levitates" if gain < 0 else ""
    if follows > _FOLLOWS:
        return f"the {effort} rises with it (correlation {follows:.2f})"
    if follows <= -_FOLLOWS:
        return ""
    return "it is called so" if distance else ""


def below_the_magnet(guess: RecordingGuess, rig: Rig, folder: Path) -> RecordingGuess:
    """The guess with what a named rig tells of a suspended rotor: the bias in its currents, and the gap at rest.

    Args:
        guess: of one file.
        rig: on which it was recorded.
        folder: in which the file is.

    Returns:
        Itself for other rigs than one with a single magnet. A distance whose mean is not near the rig's gap stays asked
        for: it is counted from another place than the magnet, or in another unit.
    """
    if not rig.controlled or "pair" in rig.capabilities or "displacement" not in guess.channels:
        return guess
    read, moved = contents(read_columns(folder / guess.file)).columns, guess.channels["displacement"]
    used = slice(guess.part[0], guess.part[0] + guess.part[1]) if guess.part else slice(None)
    asked = ("displacement", "current", *(("voltage",) if tells_current(rig) else ()))
    near = abs(float(replace(moved, offset=0.0).values(read)[used].mean()) + rig.gap) < rig.clearance

    def told(column: ColumnGuess) -> ColumnGuess:
        if TOTAL in column.ask:
            column = _answered(replace(column, total=True), TOTAL, "it includes the current that carries the weight")
        elif AT_THE_GAP in column.ask and near and not column.offset:
            column = _answered(replace(column, offset=rig.gap), AT_THE_GAP, "0 is at the gap of the rig")
        return _asking(column, KNOWN_ZERO) if column.channel in asked else column

    rotor = replace(guess.rotor, value="suspended", confidence=STATED, reason="the rig has one magnet", ask="")
    return replace(guess, columns=tuple(told(c) for c in guess.columns), rotor=rotor)


def _answered(column: ColumnGuess, asked: str, why: str) -> ColumnGuess:
    """A column with one of its questions answered."""
    left = "; ".join(part for part in column.ask.replace(asked, "").split("; ") if part)
    return replace(column, ask=left, reason=f"{column.reason}; {why}")


def around_the_centre(guess: RecordingGuess, dataset: "xr.Dataset") -> RecordingGuess:
    """The guess with a question for the offset of positions that are not counted from where the rotor is.

    Args:
        guess: of one file.
        dataset: the file, read by it.
    """
    apart = {
        str(name)
        for name, values in dataset.data_vars.items()
        if str(name).partition("_")[0] in ("displacement", "reference")
        and abs(values.values.mean()) > _APART * np.ptp(values.values)
    }
    return replace(guess, columns=tuple(_asking(c, CENTRE) if _open(c, apart) else c for c in guess.columns))


def _open(column: ColumnGuess, apart: set[str]) -> bool:
    """Whether a position is one of those, beside a displacement that is, and no offset is asked for yet."""
    both = {column.channel, column.channel.replace("reference", "displacement")} <= apart
    return both and AT_THE_GAP not in column.ask and not column.offset


def _follows(positions: np.ndarray, effort: np.ndarray) -> float:
    """Correlation of position and effort (samples,), of the means over as many samples as show most of it."""
    found = [correlation(positions, effort)]
    for samples in _MEANS:
        count = positions.size // samples
        if count >= _LEAST:
            means = [v[: count * samples].reshape(count, samples).mean(axis=1) for v in (positions, effort)]
            found.append(correlation(*means))
    return max(found, key=abs)


def _other_way(wanted: np.ndarray, positions: np.ndarray) -> bool:
    """Whether a set point (samples,) counts against the positions; of a faster one than the loop nothing is told."""
    count = positions.size // _MEANS[-1]
    if count < _LEAST:
        return False
    slow, reached = (v[: count * _MEANS[-1]].reshape(count, -1).mean(axis=1) for v in (wanted, positions))
    return bool(slow.std() > _SLOW * wanted.std() > 0 and correlation(slow, reached) < -_FOLLOWS)


def asked_for_the_centre(column: ColumnGuess) -> ColumnGuess:
    """A position that is asked for its offset, as it is in another file of the same rig."""
    return column if column.offset or CENTRE in column.ask or AT_THE_GAP in column.ask else _asking(column, CENTRE)


def _asking(column: ColumnGuess, ask: str) -> ColumnGuess:
    return replace(column, ask=f"{column.ask}; {ask}" if column.ask else ask)


def _reversed(column: ColumnGuess, why: str) -> ColumnGuess:
    reason = f"{column.reason}; a distance from the magnet: {why}"
    turned = replace(with_scale(column, -column.scale), reason=reason)
    return turned if column.offset else _asking(turned, AT_THE_GAP)
