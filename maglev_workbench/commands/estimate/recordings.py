"""Identification of every recording of a campaign: each axis alone, and x and y together if both were excited."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from maglev_env.evaluation.identification import Identification, identify
from maglev_env.evaluation.identification_planar import PlanarIdentification, identify_planar
from maglev_env.evaluation.known_mass import (
    planar_within_tolerance_of_mass,
    within_tolerance_of_channels,
    within_tolerance_of_mass,
)
from maglev_env.loop.axes import AXES
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.each_recording import each_recording
from maglev_env.recordings.left_out import LeftOut, NoneTells, TellsNothing
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.rig.rig import axis_rig
from sim2real.compared.standing import standing
from sim2real.pooled import Pooled, pooled
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record, read_records
from sim2real.rest_alone import rest_alone

Track = Callable[[Iterable[RecordingSpec]], Iterable[RecordingSpec]]


@dataclass(frozen=True)
class Identified:
    """Results with the names of their recordings.

    Attributes:
        axes: Identification of single axes.
        planar: Identification of x and y together.
        open: Recordings without an excitation that repeats or is recorded.
        aperiodic: Recordings whose excitation is recorded and does not repeat.
        pooled: The named rig in all recordings, where some do not repeat.
        linear: Whether only linear responses are told of a named rig whose simulation could say more, because it could
            not be fitted; the notes say why.
        left_out: Recordings that tell nothing.
        notes: Why something that is usual is missing.
    """

    axes: list[tuple[str, Identification]]
    planar: list[tuple[str, PlanarIdentification]]
    open: list[str]
    pooled: Pooled | None = None
    left_out: tuple[LeftOut, ...] = ()
    aperiodic: list[str] = field(default_factory=list)
    linear: bool = False
    notes: tuple[str, ...] = ()


def identify_campaign(
    campaign: Campaign,
    estimate_mass: bool,
    band_width: float | None,
    band_overlap: float | None,
    track: Track,
    fitted: bool = True,
) -> Identified:
    """Identify every recording.

    Args:
        campaign: with the recordings.
        estimate_mass: whether the mass is fitted too.
        band_width, band_overlap: of the estimation bands, Hz; None: the defaults.
        track: wraps the loop over the recordings, to show progress.
        fitted: whether the rig is fitted to recordings without a period; else they are only read for that.

    Raises:
        ValueError: A file cannot be identified, or none tells anything; the message says why.
    """
    found = Identified([], [], [])
    loops: dict[tuple, list[tuple[str, RecordedSignals]]] = {}
    why: dict[str, str] = {}  # recording -> why its responses tell nothing

    def identified(spec: RecordingSpec) -> None:
        if campaign.rig is not None and all(e.kind == "none" for e in spec.excitations):
            found.open.append(spec.name)
            return
        if any(e.kind == "recorded" for e in spec.excitations):
            found.aperiodic.append(spec.name)
        signals = recorded_signals(campaign, spec, read_recording(campaign, spec))
        try:
            found.axes.extend(_axes(spec, signals, campaign, estimate_mass, band_width, band_overlap))
        except ValueError as error:
            if estimate_mass:
                raise ValueError(f"{campaign.folder / spec.name}: {error}") from error
            why[spec.name] = str(error)
            if campaign.rig is not None:
                found.open.append(spec.name)  # of a named rig the simulation may still tell what a response does not
            return
        forced = any(e.at == "force" for e in signals.excitations)
        if signals.axes == 2 and forced and spec.role == "fit" and campaign.mass is not None:
            loops.setdefault((spec.gains, spec.speed_rpm), []).append((spec.name, signals))

    told, _ = each_recording(campaign, identified, track)
    if why and campaign.rig is None:
        if not found.axes:
            first, reason = next(iter(why.items()))
            raise ValueError(f"{campaign.folder / first}: {reason}")
        found = replace(found, notes=tuple(f"{file}: tells nothing without a rig ({own})" for file, own in why.items()))
    for members in loops.values():
        records = [signals for _, signals in members]
        assert campaign.mass is not None
        both = identify_planar(records, campaign.rig, campaign.mass, band_width, band_overlap)
        if campaign.rig is not None:
            x, y = (axis_rig(campaign.rig, axis).tolerance.get("mass", 0.0) for axis in range(2))
            both = planar_within_tolerance_of_mass(both, (x, y))
        found.planar.append((" + ".join(file for file, _ in members), both))
    if found.open:
        try:
            told, together = _pooled(campaign) if fitted else (standing(*read_records(campaign))[0], None)
        except ValueError as error:
            if not why:
                raise
            first, reason = next(iter(why.items()))
            raise ValueError(f"{campaign.folder / first}: {reason} | the rig in all recordings: {error}") from error
        found = replace(found, pooled=together, notes=_alone(why))
    elif fitted and found.aperiodic and campaign.rig is not None:
        # Responses are those of a straight line through the force law, and know nothing of lags: of a named rig the
        # simulation says more. Where it cannot, they stand alone.
        try:
            _, together = _pooled(campaign)
            found = replace(found, pooled=together)
        except ValueError as error:
            found = replace(found, linear=True, notes=(f"the rig is not fitted to these recordings: {error}",))
    return replace(found, left_out=told.left_out)


def _axes(
    spec: RecordingSpec, signals: RecordedSignals, campaign: Campaign, *options: object
) -> list[tuple[str, Identification]]:
    """The identification of a recording; with two axes, of each axis alone."""
    rig, file = campaign.rig, spec.name
    parts = [(file, signals)]
    if signals.axes == 2:
        parts = [(f"{file}, {name}", axis_signals(signals, axis)) for axis, name in enumerate(AXES)]
        # An axis that is not excited cannot be identified alone.
        pushed = [(name, own) for name, own in parts if any(e.at == "force" for e in own.excitations)]
        parts = pushed or [(name, own) for name, own in parts if own.excitations]
    found = []
    for name, own in parts:
        one = rig if rig is None or own.axis is None else axis_rig(rig, own.axis)
        mass = campaign.mass if one is None else one.mass
        tolerance = 0.0 if one is None else one.tolerance.get("mass", 0.0)
        alone = within_tolerance_of_mass(identify(own, one, mass, *options), tolerance)
        found.append((name, within_tolerance_of_channels(alone, *_errors(spec, own.axis))))
    return found


def _errors(spec: RecordingSpec, axis: int | None) -> tuple[dict[str, float], float]:
    """Relative errors of the scales of displacement, current (else the command, which stands for it) and force along an
    axis, and that of the time between them, s, as far as a campaign states them."""
    ending = "" if axis is None else f"_{AXES[axis]}"
    drive = "current" if f"current{ending}" in spec.channels else "command"
    sources = {
        name: spec.channels.get(f"{by}{ending}")
        for name, by in (("displacement", "displacement"), ("current", drive), ("force", "force"))
    }
    scales = {name: source.scale_tolerance if source else 0.0 for name, source in sources.items()}
    late = [(source.delay_tolerance or 0.0) if source else 0.0 for source in sources.values()]
    return scales, float(sum(own**2 for own in late) ** 0.5)


def _alone(why: Mapping[str, str]) -> tuple[str, ...]:
    """What is said of recordings (recording -> why) that tell something together with the rig alone."""
    reasons = dict.fromkeys(why.values())
    return tuple(
        f"{', '.join(f for f, r in why.items() if r == reason)}: no bands alone, the rig is fitted to it ({reason})"
        for reason in reasons
    )


def _pooled(campaign: Campaign) -> tuple[Campaign, Pooled]:
    """The campaign of what was used, and the rig in all recordings to fit; holdouts are for the diagnosis."""
    try:
        read, every = read_records(campaign)
    except (TellsNothing, NoneTells) as nothing:
        if (found := rest_alone(campaign, str(nothing).removeprefix(f"{campaign.folder}: "))) is None:
            raise
        return campaign, found
    told, records = standing(read, every)
    held_out = tuple(r.name for r in records if r.role == "holdout")
    fitted = [r for r in records if r.role == "fit"]
    found = pooled(fitted, resting=[r for r in every if r.role == "fit"])
    return told, replace(found, held_out=held_out, notes=(*found.notes, *_notes(fitted)))


def _notes(records: Sequence[Record | OpenRecord]) -> tuple[str, ...]:
    """What was assumed of recordings, each once, with the recordings that it is about."""
    about: dict[str, list[str]] = {}
    for record in records:
        for note in dict.fromkeys(record.notes):
            about.setdefault(note, []).append(record.name)
    return tuple(f"{', '.join(names)}: {note}" for note, names in about.items())
