"""A campaign as a diagnosis needs it: for each recording, the spectra of its steady periods and what drove it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from estimation.lines.periods import period_spectra, split_periods, transient_periods, two_unsteady
from estimation.lines.tones import Tone, remove_tones
from maglev_env.channels import MEASURED, SHOWN_BY
from maglev_env.experiment import Experiment, sampling, without_noise
from maglev_env.kernel.driven import Drive
from maglev_env.loop.axes import suffixes
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.recordings.campaign import Campaign, RecordingSpec, load_campaign
from maglev_env.recordings.derived import under_voltage
from maglev_env.recordings.each_recording import check_left, each_recording
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.rig.excitation import PLACES, axis_excitations, lines_at
from maglev_env.rig.rig import Rig
from sim2real.recorded.along_motion import Motion
from sim2real.recorded.at_rest.static_evidence import Rests, rests_of
from sim2real.recorded.channel_errors import ChannelError, channel_errors
from sim2real.recorded.current_by_voltage import driven_by_voltage, told_by_voltage
from sim2real.recorded.open_reading import open_record
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.static_load import Load, load_in_words, static_load
from sim2real.recorded.ticks import jitters
from sim2real.recorded.tones import ON_LINE, near_tones, wander_in_words
from sim2real.recorded.unstated_controller import unstated_controller
from sim2real.recorded.wander import without_leak, without_wander

WITHOUT_PERIOD = "the ticks of its controller jitter, so it is compared as one that does not repeat"
UNSTEADY = "its two steady periods differ by more than noise, so it is compared as one that does not repeat"
WITHOUT_CONTROLLER = "its controller is not stated, so it is compared as one that does not repeat"
REPEATS = 10.0  # power off the stated lines of an excitation, of what noise leaves there, from which it is part of it


@dataclass(frozen=True)
class Heard:
    """A tone of known origin on a line.

    Attributes:
        amplitude: Complex (axes,), as it leaves of the opened loop, m.
        force: Whether it is simulated as a force on the rotor; else as an error of the reading.
    """

    amplitude: np.ndarray
    force: bool


@dataclass(frozen=True)
class Record:
    """One recording, steady and periodic.

    Attributes:
        name: File name.
        role: "fit" or "holdout".
        nominal: The rig as the campaign states it.
        experiment: The rig without noise and converters, under this recording's gains and excitations.
        lines: Harmonic numbers (n,).
        frequency: Frequencies (n,), Hz.
        periods: Complex amplitudes of each period (P, axes, n), by channel.
        driven: Whether each line is excited (axes, n), by place.
        waves: One period (axes, samples) at the control rate, by place.
        series: Steady periods (axes, samples), by channel.
        start: Time of the first steady sample after the recording's first sample, s.
        dropped: Number of transient periods.
        tones: Tones that were found between the harmonics and removed.
        notes: What was assumed.
        errors: What may be wrong with its channels.
        rests: What its means say of a suspended mass; None: nothing.
        elsewhere: Frequencies (Hz) of tones of unknown origin that other recordings show.
        heard: Line -> the tone on it that is simulated, too.
        humming: What these add to the waves in its simulation, (axes, samples) by place.
        load: With which a rotor between opposed magnets is simulated to rest where it was recorded; None: none.
    """

    name: str
    role: str
    nominal: Rig
    experiment: Experiment
    lines: np.ndarray
    frequency: np.ndarray
    periods: Mapping[str, np.ndarray]
    driven: Mapping[str, np.ndarray]
    waves: Mapping[str, np.ndarray]
    series: Mapping[str, np.ndarray]
    start: float
    dropped: int
    tones: tuple[Tone, ...] = ()
    notes: tuple[str, ...] = ()
    errors: tuple[ChannelError, ...] = ()
    rests: Rests | None = None
    elsewhere: tuple[float, ...] = ()
    heard: Mapping[int, Heard] = field(default_factory=dict)
    humming: Mapping[str, np.ndarray] = field(default_factory=dict)
    load: Load | None = None

    @property
    def masked(self) -> np.ndarray:
        """Lines (n,) on which a tone of known origin would lie, or one that other recordings show."""
        e = self.experiment
        return near_tones(self.frequency, ON_LINE * e.fundamental, e.speed_rpm, self.elsewhere)

    @property
    def axes(self) -> int:
        return self.experiment.rig.axes

    @cached_property
    def drive(self) -> Drive:
        """What its simulation runs under."""
        waves = {place: wave + self.humming.get(place, 0.0) for place, wave in self.waves.items()}
        return Drive(self.experiment, waves, load=self.load)

    @property
    def count(self) -> int:
        """Number of periods kept."""
        return len(self.periods["displacement"])

    def mean(self, channel: str) -> np.ndarray:
        """Mean complex amplitudes (axes, n)."""
        return self.periods[channel].mean(axis=0)

    def driving(self, place: str) -> np.ndarray:
        """Complex amplitudes (axes, n) of the excitation at "force" (N), "current" (A) or "reference" (m)."""
        return period_spectra(self.waves[place], self.lines)

    @property
    def excited(self) -> np.ndarray:
        """Whether a line is excited anywhere, along any axis, (n,)."""
        return np.any([d.any(axis=0) for d in self.driven.values()], axis=0)


def read_records(campaign: str | Path | Campaign) -> tuple[Campaign, tuple[Record | OpenRecord, ...]]:
    """Read every recording of a campaign that names its rig.

    Returns:
        The campaign of the recordings that tell something, with the others in its `left_out`; and their records.

    Raises:
        ValueError: A file is wrong (see `read_recording`), or something that a diagnosis needs is missing: a rig, a
            displacement, or the gains of a rotor that cannot levitate without control; or no recording to fit tells
            anything.
    """
    loaded = campaign if isinstance(campaign, Campaign) else load_campaign(campaign)
    if loaded.rig is None:
        raise ValueError(
            f"{loaded.folder / 'campaign.toml'}: rig is missing; a gap is measured against a nominal rig: name a "
            "preset or a rig TOML"
        )
    if all(spec.role == "holdout" for spec in loaded.recordings):
        raise ValueError(f"{loaded.folder / 'campaign.toml'}: every recording is a holdout; give one the role fit")
    told, records = each_recording(loaded, lambda spec: _record(loaded, spec))
    _check_apart(told, records)
    check_left(loaded, told.left_out, any(r.role == "fit" for r in records))
    return told, tuple(records)


def _record(campaign: Campaign, spec: RecordingSpec) -> Record | OpenRecord:
    dataset = read_recording(campaign, spec)
    if spec.samples_per_period is None:
        return open_record(campaign, spec, dataset)
    if jitters(dataset, spec.gains, spec.excitations, campaign.rig.axes, campaign.rig.control_rate):
        found = open_record(campaign, spec, dataset)
        return replace(found, notes=(WITHOUT_PERIOD, *found.notes))
    if _under_voltage(campaign.rig, {name.partition("_")[0] for name in spec.channels}):
        return open_record(campaign, spec, dataset)  # driven by the voltage as it was measured, whatever the controller
    where = campaign.folder / spec.name
    signals = recorded_signals(campaign, spec, dataset)
    rig, axes = campaign.rig, campaign.rig.axes
    if signals.axes != axes:
        raise ValueError(f"{where}: one axis of a rig of two; a diagnosis compares both: record x and y, or use a "
                         "rig TOML with axes = 1")  # fmt: skip
    names = suffixes(axes)
    channels = {
        kind: np.array([signals.channels[kind + s] for s in names])
        for kind in dict.fromkeys((*MEASURED, *SHOWN_BY.values()))
        if all(kind + s in signals.channels for s in names)
    }
    if "displacement" not in channels:
        raise ValueError(f"{where}: the channel displacement is missing; nothing is known of the rotor without it")
    unknown = spec.gains is None and rig.controlled
    if unknown and (not rig.support_stiffness or unstated_controller(rig, channels, spec.sample_rate)):
        # Without its controller the loop has no response to compare; what the current did to the rotor is still known.
        found = open_record(campaign, spec, dataset)
        return replace(found, notes=(WITHOUT_CONTROLLER, *found.notes))
    gains = spec.gains if spec.gains is not None else NO_CONTROLLER
    multiple, every = sampling(spec.sample_rate, rig.control_rate)
    channels = {kind: values[:, ::multiple] for kind, values in channels.items()}
    excitations = tuple(e.on_grid(signals.sample_rate) for e in signals.excitations if e.periodic)
    offset = channels["reference"].mean(axis=1) if "reference" in channels else np.zeros(axes)
    rate = None if every == 1 else spec.sample_rate
    e = Experiment(rig, gains, excitations, sample_rate=rate, speed_rpm=spec.speed_rpm)
    e = without_noise(e)
    n = e.samples_per_period // every
    lines = np.arange(1, lines_at(excitations).max() + 1)
    measured = {k: v for k, v in channels.items() if k in MEASURED}
    whole_periods = next(iter(measured.values())).shape[1] // n * n
    measured = {kind: values[:, :whole_periods] for kind, values in measured.items()}
    toneless, tones = remove_tones(measured, n, spec.sample_rate / multiple)
    split = split_periods(np.concatenate(list(toneless.values())), n)
    spectra = period_spectra(split.reshape(len(split) * split.shape[1], n), lines).reshape(*split.shape[:2], -1)
    driven = {
        place: np.array([np.isin(lines, lines_at(axis_excitations(excitations, a), place)) for a in range(axes)])
        if axes == 2
        else np.isin(lines, lines_at(excitations, place))[None]
        for place in PLACES
    }
    first, excited = list(measured).index("displacement") * axes, np.any(list(driven.values()), axis=(0, 1))
    moved = spectra[:, first : first + axes][..., excited]
    dropped = transient_periods(moved.reshape(len(spectra), -1))
    if len(moved) - dropped == 2 and any(two_unsteady(own) for own in np.moveaxis(moved[dropped:], 1, 0)):
        found = open_record(campaign, spec, dataset)
        return replace(found, notes=(UNSTEADY, *found.notes))
    whole = slice(dropped * n, whole_periods)
    if dropped:  # beside a transient, a tone does not stand out
        toneless, tones = remove_tones({k: v[:, whole] for k, v in measured.items()}, n, spec.sample_rate / multiple)
    series = {kind: without_wander(values, n) for kind, values in toneless.items()}
    split = split_periods(np.concatenate(list(series.values())), n)
    kept = period_spectra(split.reshape(len(split) * split.shape[1], n), lines).reshape(*split.shape[:2], -1)
    periods = {kind: kept[:, i * axes : (i + 1) * axes] for i, kind in enumerate(series)}
    periods = without_leak(periods, lines, excited, n)
    load = _load(e, channels, whole, every)
    waves = _waves(e, channels, driven, lines, signals.hold_rate, whole, offset)
    notes = (*signals.assumed, *load_in_words(load, spec.name))
    notes += (f"the first {dropped} period(s) carry a transient and were dropped",) * bool(dropped)
    notes += tuple(wander_in_words(tones, e.fundamental / len(split)))
    start = dropped / e.fundamental
    return Record(
        spec.name,
        spec.role,
        rig,
        e,
        lines,
        lines * e.fundamental,
        periods,
        driven,
        waves,
        series,
        start,
        dropped,
        tuple(tones),
        notes,
        channel_errors(spec),
        rests_of(rig, spec, dataset),
        load=load,
    )


def _load(e: Experiment, channels: Mapping[str, np.ndarray], whole: slice, every: int) -> Load | None:
    """What the magnets lack where the rotor rests; None where nothing is lacking, or neither current nor command tells
    what they pull."""
    told = next(((kind, held) for kind, held in (("current", False), ("command", True)) if kind in channels), None)
    if told is None:
        return None
    motion = Motion(channels[told[0]][:, whole], channels["displacement"][:, whole], told[1], every)
    return static_load(e, motion, np.zeros(e.rig.axes))


def _under_voltage(rig: Rig, kinds: Collection[str]) -> bool:
    """Whether the coil's current is what its voltage and the motion make of it, by what a recording holds."""
    return told_by_voltage(rig, kinds) or (under_voltage(rig) and driven_by_voltage(rig, kinds) and "current" in kinds)


def _waves(
    e: Experiment,
    channels: Mapping[str, np.ndarray],
    driven: Mapping[str, np.ndarray],
    lines: np.ndarray,
    hold_rate: float | None,
    whole: slice,
    offset: np.ndarray,
) -> dict[str, np.ndarray]:
    """One period of each excitation at the control rate: the excited lines of its channel, or of its design.

    Steps have lines up to half the sample rate, of which a campaign states the strong ones; the others make the kicks
    of current in which the magnet's law bends most. A force is measured: what its channel has elsewhere may be noise.
    """
    axes, n = e.rig.axes, e.samples_per_period
    waves = {}
    for place, on in driven.items():
        spectrum = np.zeros((axes, n // 2 + 1), complex)
        if (channel := channels.get(SHOWN_BY[place])) is not None:
            per_period = e.recorded_per_period
            each = channel[:, whole].reshape(axes, -1, per_period)
            every_line = np.arange(1, per_period // 2 + 1)
            found, stated = period_spectra(each.mean(axis=1), every_line), np.zeros((axes, every_line.size), bool)
            stated[:, lines - 1] = on
            further = place != "force" and _repeats(period_spectra(each, every_line), ~stated)
            if place == "force" and hold_rate is None:  # a continuous force: find the held sequence with these lines
                x = every_line * e.fundamental / e.rig.control_rate
                found = found / (np.sinc(x) * np.exp(-1j * np.pi * x))
            spectrum[:, every_line] = np.where(stated | further, found, 0.0) * (n / 2)
        elif on.any():
            spectrum = np.fft.rfft(np.atleast_2d(e.waveform(place)), axis=-1)
        waves[place] = np.fft.irfft(spectrum, n, axis=-1)
    waves["reference"] += offset[:, None]
    return waves


def _repeats(each: np.ndarray, lines: np.ndarray) -> bool:
    """Whether spectra (axes, periods, n) of one channel have more in common at these lines (axes, n) than noise has."""
    count = each.shape[1]
    if count < 2:
        return False
    common = np.abs(each.mean(axis=1)) ** 2
    noise = each.var(axis=1, ddof=1) / count
    return bool(common[lines].sum() > REPEATS * noise[lines].sum())


def _check_apart(campaign: Campaign, records: Sequence[Record | OpenRecord]) -> None:
    """Refuse a holdout that repeats one of the fit recordings.

    Raises:
        ValueError: Two recordings hold the same displacement.
    """
    for judged in (r for r in records if r.role == "holdout"):
        for fitted in (r for r in records if r.role == "fit"):
            one, other = judged.series["displacement"], fitted.series["displacement"]
            if one.shape == other.shape and np.array_equal(one, other):
                raise ValueError(
                    f"{campaign.folder}: the holdout {judged.name} is the fit recording {fitted.name} again; it can "
                    "judge nothing: record another realisation"
                )
