"""What the user states of a rig, on the command line or where the terminal asks."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path

from maglev_env.recordings.guess.columns.stated_columns import with_stated
from maglev_env.recordings.guess.recording import RecordingGuess, guess_recording


@dataclass(frozen=True)
class Stated:
    """What is known of the rig beside its files.

    Args:
        rate: sample rate, Hz, of every file that does not tell it.
        mass: moving mass, kg.
        rig: preset, or a rig TOML beside the campaign.
        magnet: kind of magnet for the skeleton of rig.toml.
    """

    rate: float | None = None
    mass: float | None = None
    rig: str | None = None
    magnet: str | None = None


def values_of(option: str, texts: Iterable[str]) -> dict[str, float]:
    """The values of an option that is repeated as COLUMN=VALUE.

    Raises:
        ValueError: A text is not of that form.
    """
    found = {}
    for text in texts:
        name, _, value = text.rpartition("=")
        try:
            number = float(value)
        except ValueError:
            number = nan
        if not name.strip() or not isfinite(number):
            raise ValueError(f"{option} {text}: write COLUMN=VALUE, such as {option} hall_probe=0.002")
        found[name.strip()] = number
    return found


def scales_of(texts: Iterable[str]) -> dict[str, float]:
    """The values of --scale.

    Raises:
        ValueError: A text is not COLUMN=VALUE, or its value is 0.
    """
    scales = values_of("--scale", texts)
    for name, value in scales.items():
        if not value:
            raise ValueError(f"--scale {name}=0: a scale of 0 leaves nothing of a column")
    return scales


def guess_with(
    file: Path, rate: float | None, scales: Mapping[str, float], zeros: Mapping[str, float]
) -> RecordingGuess:
    """The guess of a data file with what the user states of its rate (Hz) and its columns.

    Raises:
        OSError: The file cannot be read.
        ValueError: It is no data file, or holds no columns.
    """
    guess = guess_recording(file, rate=rate)
    columns = with_stated(guess.columns, scales, zeros)
    return guess if columns == guess.columns else guess_recording(file, rate=rate, columns=columns)


def check_columns(guesses: Iterable[RecordingGuess], values: Mapping[str, float], option: str) -> None:
    """Check that every column for which a value is stated is used in one of the files.

    Raises:
        ValueError: One is not; the message has those that are.
    """
    used = {name: c.label for g in guesses for c in g.columns if c.channel for name in (c.label, c.column)}
    for name in values:
        if name not in used:
            raise ValueError(
                f"{option} {name}: no such column is used; there are {', '.join(dict.fromkeys(used.values()))}"
            )
