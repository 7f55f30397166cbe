"""Source of the coil's recordings, a campaign or one file, and the files for the estimated gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from maglev_env.recordings.campaign import Campaign, RecordingSpec, load_campaign
from maglev_env.rig.excitation import Excitation
from maglev_workbench.columns import column_source

if TYPE_CHECKING:
    from maglev_workbench.commands.selfsense.estimate.recorded_coils import Coil


@dataclass(frozen=True)
class OneFile:
    """How to read a single file: rate Hz (None: not given), columns name[*scale] of the current and the voltage."""

    rate: float | None = None
    current: str = "current"
    voltage: str = "voltage"


def source_campaign(source: Path, one: OneFile) -> Campaign:
    """The campaign, or one that contains a single file.

    Raises:
        ValueError: An option is missing, or has no meaning for a campaign.
        FileNotFoundError: The source does not exist.
    """
    if not source.exists():
        raise FileNotFoundError(f"{source} does not exist; name a campaign folder or a data file")
    if source.is_dir() or source.suffix == ".toml":
        if one != OneFile():
            raise ValueError(f"--rate, --current and --voltage go with one file; the campaign {source} states its own")
        return load_campaign(source)
    if one.rate is None or not 0 < one.rate < float("inf"):
        raise ValueError(f"{source}: one file needs its sample rate: --rate HZ")
    channels = {"current": column_source(one.current), "voltage": column_source(one.voltage)}
    excitations = (Excitation("none"),)
    spec = RecordingSpec(source.name, "fit", one.rate, 0, None, None, 0.0, None, excitations, channels)
    return Campaign(source.parent, None, None, (spec,))


def without_currents(campaign: Campaign) -> Campaign:
    """The campaign without the currents of its coils: what is wrong with them, the estimator marks by itself."""
    kept = [
        replace(spec, channels={n: c for n, c in spec.channels.items() if n.partition("_")[0] != "current"})
        for spec in campaign.recordings
    ]
    return replace(campaign, recordings=tuple(kept))


def estimate_files(page: Path, coils: list[Coil]) -> list[Path]:
    """File of each estimated gap: in the page's folder, named after the page, and with several coils the recording."""
    if len(coils) == 1:
        return [page.with_suffix(".npz")]
    names = ["-".join((*Path(c.spec.file).with_suffix("").parts, *filter(None, [c.suffix.lstrip("_")]))) for c in coils]
    unique = [n if names.count(n) == 1 else f"{n}-{i}" for i, n in enumerate(names, 1)]
    return [page.with_name(f"{page.stem}-{name}.npz") for name in unique]
