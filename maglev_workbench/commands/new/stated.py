"""What the user states of a rig, on the command line or where the terminal asks."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from maglev_env.recordings.guess.recording import RecordingGuess


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
            found[name.strip()] = float(value)
        except ValueError:
            found = {}
        if not name.strip() or not found:
            raise ValueError(f"{option} {text}: write COLUMN=VALUE, such as {option} hall_probe=0.002")
    return found


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
