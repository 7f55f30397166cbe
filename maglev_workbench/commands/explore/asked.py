"""What the user names: a rig or a campaign. It imports little, so that a wrong name is answered at once."""

from dataclasses import dataclass
from pathlib import Path

from maglev_env.fields import toml_text
from maglev_env.recordings.campaign import SCHEMA, Campaign, load_campaign
from maglev_env.rig.rig import PRESETS, Rig, load_rig
from maglev_workbench.explore.copied import Source


@dataclass(frozen=True)
class Asked:
    """The rig, where it comes from, and the campaign that was recorded on it, if one was named."""

    rig: Rig
    source: Source
    campaign: Campaign | None = None


def asked(source: str) -> Asked:
    """The rig or campaign of this name.

    Raises:
        ValueError: It is neither, or has no control loop; the message says what to name instead.
        OSError: It cannot be read.
    """
    if not _is_campaign(source):
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
    preset = rig.name if rig.name in PRESETS and load_rig(rig.name) == rig else None  # without [parameters] of its own
    return Asked(rig, Source(preset, f"load_campaign({source!r}).rig"), campaign)


def _is_campaign(source: str) -> bool:
    path = Path(source)
    if source in PRESETS or not path.exists():
        return False
    return path.is_dir() or (path.suffix == ".toml" and SCHEMA in toml_text(path, "rig or campaign"))


def _controlled(rig: Rig, source: str) -> Rig:
    if not rig.controlled:
        raise ValueError(f"{source}: rig {rig.name} has no magnets and so no control loop to explore; name another rig")
    return rig
