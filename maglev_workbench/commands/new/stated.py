"""What the user states of a rig, on the command line or where the terminal asks."""

from dataclasses import dataclass


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
