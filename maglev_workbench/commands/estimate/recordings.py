"""Every recording of a campaign identified: each axis by itself, and x and y together where both were pushed."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from maglev_env.evaluation.identification import Identification, identify
from maglev_env.evaluation.identification_planar import PlanarIdentification, identify_planar
from maglev_env.loop.axes import AXES
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.rig.rig import Rig, axis_rig
from sim2real.pooled import Pooled, pooled
from sim2real.records import read_records

Track = Callable[[Iterable[RecordingSpec]], Iterable[RecordingSpec]]


@dataclass(frozen=True)
class Identified:
    """What was found, each beside the recordings it was found in: of single axes, of x and y together, and of the named
    rig in all recordings (None without a rig). open: recordings without an excitation that repeats or is recorded."""

    axes: list[tuple[str, Identification]]
    planar: list[tuple[str, PlanarIdentification]]
    open: list[str]
    pooled: Pooled | None = None


def identify_campaign(
    campaign: Campaign,
    mass: float | None,
    estimate_mass: bool,
    band_width: float | None,
    band_overlap: float | None,
    track: Track,
) -> Identified:
    """Identify every recording.

    Args:
        campaign: where the recordings are.
        mass: moving mass, kg; None where it is not known.
        estimate_mass: fit it too.
        band_width, band_overlap: of the estimation bands, Hz; None: the defaults.
        track: wraps the loop over the recordings, to show progress.

    Raises:
        ValueError: names the file that cannot be identified and says why.
    """
    found = Identified([], [], [])
    loops: dict[tuple, list[tuple[str, RecordedSignals]]] = {}
    for spec in track(campaign.recordings):
        if campaign.rig is not None and all(e.kind == "none" for e in spec.excitations):
            found.open.append(spec.file)
            continue
        signals = recorded_signals(campaign, spec, read_recording(campaign, spec))
        try:
            found.axes.extend(_axes(spec.file, signals, campaign.rig, mass, estimate_mass, band_width, band_overlap))
        except ValueError as error:
            raise ValueError(f"{campaign.folder / spec.file}: {error}") from error
        if signals.axes == 2 and spec.role == "fit" and mass is not None:
            loops.setdefault((spec.gains, spec.speed_rpm), []).append((spec.file, signals))
    for members in loops.values():
        records = [signals for _, signals in members]
        both = identify_planar(records, campaign.rig, mass, band_width, band_overlap)
        found.planar.append((" + ".join(file for file, _ in members), both))
    if found.open:
        found = replace(found, pooled=pooled([r for r in read_records(campaign)[1] if r.role == "fit"]))
    return found


def _axes(
    file: str, signals: RecordedSignals, rig: Rig | None, mass: float | None, *options: object
) -> list[tuple[str, Identification]]:
    """The identification of a recording, of each axis by itself where there are two."""
    parts = [(file, signals)]
    if signals.axes == 2:
        parts = [(f"{file}, {name}", axis_signals(signals, axis)) for axis, name in enumerate(AXES)]
        # An axis that nothing pushes along tells nothing by itself.
        pushed = [(name, own) for name, own in parts if any(e.at == "force" for e in own.excitations)]
        parts = pushed or [(name, own) for name, own in parts if own.excitations]
    found = []
    for name, own in parts:
        one = rig if rig is None or own.axis is None else axis_rig(rig, own.axis)
        # A mass given stands for the rig's common one; an axis may have its own share of it.
        share = mass if mass is None or one is None or rig is None else mass * one.mass / rig.mass
        found.append((name, identify(own, one, share, *options)))
    return found
