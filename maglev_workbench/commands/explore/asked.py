"""What the user names: a rig or a campaign. It imports little, so that a wrong name is answered at once."""

from dataclasses import dataclass
from pathlib import Path

from maglev_env.fields import toml_text
from maglev_env.recordings.campaign import Campaign, load_campaign
from maglev_env.recordings.campaign_file import SCHEMA
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import PRESETS, load_rig
from maglev_workbench.explore.copied import Source

CORRECTED = Path("diagnosis", "corrected.toml")  # in the folder of a campaign, where maglev diagnose writes it


@dataclass(frozen=True)
class Asked:
    """What the page is about.

    Args:
        rig: with the effects that a diagnosis of the campaign found, if there is one.
        source: where the rig comes from.
        campaign: that was recorded on it, if one was named.
        diagnosed: whether the rig is that of a diagnosis.
    """

    rig: Rig
    source: Source
    campaign: Campaign | None = None
    diagnosed: bool = False


def asked(source: str) -> Asked:
    """The rig or campaign of this name.

    Raises:
        ValueError: It is neither, or has no control loop; the message says what to name instead.
        OSError: It cannot be read.
    """
    if not is_campaign(source):
        option = source if source in PRESETS else str(Path(source))
        return Asked(_controlled(load_rig(source), source), Source(option, f"load_rig({option!r})"))
    campaign = load_campaign(source)
    if campaign.rig is None:
        raise ValueError(f"{source}: the campaign names no rig, so there is no loop to explore; add rig = ... to it")
    if all(e.kind == "none" for r in campaign.recordings for e in r.excitations):
        raise ValueError(
            f"{source}: no recording has a stated excitation, so no response was measured; explore the rig itself"
        )
    rig = _controlled(campaign.rig, source)
    corrected = campaign.folder / CORRECTED
    if corrected.is_file():
        source = str(corrected)
        return Asked(load_rig(source), Source(source, f"load_rig({source!r})"), campaign, True)
    preset = rig.name if rig.name in PRESETS and load_rig(rig.name) == rig else None  # without [parameters] of its own
    return Asked(rig, Source(preset, f"load_campaign({source!r}).rig"), campaign)


def is_campaign(source: str) -> bool:
    """Whether this names a folder or the TOML of a campaign, and not a rig."""
    path = Path(source)
    if source in PRESETS or not path.exists():
        return False
    return path.is_dir() or (path.suffix == ".toml" and SCHEMA in toml_text(path, "rig or campaign"))


def _controlled(rig: Rig, source: str) -> Rig:
    if not rig.controlled:
        raise ValueError(f"{source}: rig {rig.name} has no magnets and so no control loop to explore; name another rig")
    return rig
