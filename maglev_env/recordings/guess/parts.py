"""The recordings that one file holds where its clock stood still between them."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from maglev_env.recordings.contents import contents
from maglev_env.recordings.files import read_columns
from maglev_env.recordings.guess.recording import ALARM, RecordingGuess, guess_recording
from maglev_env.recordings.masking import MOST_MASKED

_LATE = 1.5  # usual steps from which samples are missing
_LEAST = 0.02  # of the samples of a file, that a recording in it has


def parts_of(guess: RecordingGuess, folder: Path) -> list[RecordingGuess]:
    """The guess of each stretch without a gap, where more is missing than can be bridged; else the guess alone.

    Gains, period and excitation of each are guessed anew, since a rig may be changed in between; what is guessed or
    stated of the columns stays.

    Args:
        guess: of a file in the folder.
        folder: of the campaign.
    """
    time = guess.channels.get("time")
    if time is None or guess.rate.value is None or guess.part:
        return [guess]
    steps = np.diff(contents(read_columns(folder / guess.file)).columns[time.column])
    usual = float(np.median(steps))
    if not usual > 0:
        return [guess]
    lost = np.where(steps > _LATE * usual, np.rint(steps / usual) - 1, 0).sum()
    if not lost > MOST_MASKED * (steps.size + 1 + lost) or (steps < 0).any():
        return [guess]
    edges = [0, *(np.flatnonzero(steps > _LATE * usual) + 1).tolist(), steps.size + 1]
    stretches = [(int(a), int(b - a)) for a, b in pairwise(edges)]
    kept = [stretch for stretch in stretches if stretch[1] > _LEAST * (steps.size + 1)]
    if not 1 <= len(kept) <= 1 / _LEAST or len(stretches) == 1:
        return [guess]
    said = f"{ALARM}{lost:.0f} samples are missing in {len(stretches) - 1} gap(s): each of its {len(kept)} longer "
    said += "stretches is a recording of its own"
    return [_of_stretch(guess, folder, stretch, said) for stretch in kept]


def _of_stretch(guess: RecordingGuess, folder: Path, stretch: tuple[int, int], said: str) -> RecordingGuess:
    part = guess_recording(folder / guess.file, rate=guess.rate.value, part=stretch, columns=guess.columns)
    notes = tuple(dict.fromkeys((*guess.notes, *part.notes, said)))
    rotor = max(guess.rotor, part.rotor, key=lambda one: one.confidence)
    return replace(part, file=guess.file, rate=guess.rate, notes=notes, rotor=rotor)
