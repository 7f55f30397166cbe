"""What the user states of a rig, on the command line or where the terminal asks."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path

from maglev_env.channels import CHANNELS
from maglev_env.fields import check_known
from maglev_env.recordings.guess.columns.columns import UNUSED
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


def channels_of(texts: Iterable[str]) -> dict[str, str]:
    """The values of --channel.

    Raises:
        ValueError: A text is not COLUMN=CHANNEL, or there is no such channel.
    """
    known = {name + axis for name, c in CHANNELS.items() if c.recorded for axis in ("", "_x", "_y")} | {"time", UNUSED}
    found = {}
    for text in texts:
        name, _, channel = text.rpartition("=")
        if not name.strip():
            raise ValueError(f"--channel {text}: write COLUMN=CHANNEL, such as --channel V1=force")
        check_known([channel.strip()], known, f"--channel {name}")
        found[name.strip()] = channel.strip()
    return found


@dataclass(frozen=True)
class StatedColumns:
    """What is known of columns, by what a file calls them or by their expression.

    Args:
        channels: what they are.
        scales: SI value of one of their units.
        zeros: reading at which their SI value is 0.
    """

    channels: Mapping[str, str]
    scales: Mapping[str, float]
    zeros: Mapping[str, float]


def guess_with(file: Path, rate: float | None, stated: StatedColumns) -> RecordingGuess:
    """The guess of a data file with what the user states of its rate (Hz) and its columns.

    Raises:
        OSError: The file cannot be read.
        ValueError: It is no data file, or holds no columns.
    """
    guess = guess_recording(file, rate=rate, channels=stated.channels)
    columns = with_stated(guess.columns, stated.scales, stated.zeros)
    return guess if columns == guess.columns else guess_recording(file, rate=rate, columns=columns)


def check_columns(guesses: Sequence[RecordingGuess], stated: StatedColumns) -> None:
    """Check that every column of which something is stated is in one of the files, and used there if it has a value.

    Raises:
        ValueError: One is not; the message has those that are.
    """
    every = [c for g in guesses for c in g.columns]
    used = [c for c in every if c.channel]
    for option, values, columns, lacks in (
        ("--channel", stated.channels, every, "no file has such a column"),
        ("--scale", stated.scales, used, "no such column is used"),
        ("--zero", stated.zeros, used, "no such column is used"),
    ):
        names = {name: c.label for c in columns for name in (c.label, c.column)}
        for name in values:
            if name not in names:
                raise ValueError(f"{option} {name}: {lacks}; there are {', '.join(dict.fromkeys(names.values()))}")
