"""A recording as arrays, and its line statistics: from whole periods, or by local polynomials where nothing repeats."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from estimation.lines.local_polynomial import local_polynomial
from estimation.lines.periods import (
    LineStatistics,
    held,
    line_statistics,
    period_spectra,
    split_periods,
    transient_periods,
    two_unsteady,
)
from estimation.lines.tones import FURTHER, MOST, Tone, beside_tone, remove_tones, stands_alone
from maglev_env.channels import ANALYSED, SHOWN_BY
from maglev_env.loop.axes import AXES
from maglev_env.loop.gains import Controllers, of_axis
from maglev_env.recordings.clock import SAMPLES, corrected
from maglev_env.rig.excitation import PLACES, Excitation, axis_excitations, lines_at

UNSTEADY = (
    "its two steady periods differ by more than noise: by a start-up, a drift, or a tone between the lines, which "
    "would bias every line; record more periods, or later ones"
)


@dataclass(frozen=True)
class RecordedSignals:
    """A recording as arrays.

    Attributes:
        channels: Channels (samples,) in SI.
        sample_rate: Hz.
        excitations: What excited it.
        hold_rate: Rate at which a converter held the force channel (without one, the current), Hz; None for a reading
            of a continuous one.
        gains: Controller.
        assumed: What was assumed, in words.
        axes: 2 when its channels end in _x and _y.
        axis: Which of two axes these signals belong to.
        elsewhere: Harmonics that are driven otherwise, across the axis of these signals.
        left_out: Periods, from 0, that spectra leave out because they hold masked samples.
        masked: Samples (samples,) that are bridged, because they were clipped or missing; None: none is.
        railed: Channels that stayed at their extreme value for some samples.
    """

    channels: dict[str, np.ndarray]
    sample_rate: float
    excitations: tuple[Excitation, ...]
    hold_rate: float | None = None
    gains: Controllers | None = None
    assumed: tuple[str, ...] = ()
    axes: int = 1
    axis: int | None = None
    elsewhere: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    left_out: tuple[int, ...] = ()
    masked: np.ndarray | None = None
    railed: frozenset[str] = frozenset()

    def __repr__(self) -> str:
        samples = max((values.shape[-1] for values in self.channels.values()), default=0)
        return f"<RecordedSignals {', '.join(self.channels)}: {samples} samples at {self.sample_rate:g} Hz>"

    @property
    def periodic(self) -> bool:
        return any(e.periodic for e in self.excitations)


@dataclass(frozen=True)
class RecordSpectra:
    """Line statistics of a recording.

    Attributes:
        all: At every line that it resolves.
        force: At its force lines, with the hold of the force's converter removed.
        driven: Lines excited at "force", "current" and "reference".
        transient_periods: Leading periods that were dropped.
        leftover: Samples that belong to no period.
        tones: What was removed, as it does not repeat with the excitation.
        fast: Share by which the recorder's clock was fast, which was corrected.
    """

    all: LineStatistics
    force: LineStatistics
    driven: Mapping[str, np.ndarray]
    transient_periods: int
    leftover: int
    tones: tuple[Tone, ...] = ()
    fast: float = 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """What was taken out or corrected, in words."""
        if not self.fast:
            return self._tone_notes
        which = "fast" if self.fast > 0 else "slow"
        clock = f"the recorder's clock is {1e6 * abs(self.fast):.3g} ppm {which} against that of the excitation"
        return (f"{clock}: the recording was resampled by the latter", *self._tone_notes)

    @property
    def _tone_notes(self) -> tuple[str, ...]:
        if not self.tones:
            return ()
        at = ", ".join(f"{tone.frequency:.4g}" for tone in sorted(self.tones, key=lambda t: t.frequency))
        several = len(self.tones) > 1
        which, were = ("tones", "were") if several else ("a tone", "was")
        return (f"{which} of {at} Hz that the excitation does not hold {were} taken out",)


def axis_signals(signals: RecordedSignals, axis: int) -> RecordedSignals:
    """One axis (0: x, 1: y) of an x-y recording under one-axis names, with what excites it along that axis.

    They give D's direct coefficients (eq 5.10-5.12).
    """
    if signals.axes == 1:
        return signals
    ending = f"_{AXES[axis]}"
    other = f"_{AXES[1 - axis]}"
    # A channel that belongs to no axis, such as the speed, goes with each; a channel of this axis takes precedence.
    shared = {
        name: v for name, v in signals.channels.items() if not name.endswith((ending, other)) and name not in ANALYSED
    }
    channels = {name.removesuffix(ending): v for name, v in signals.channels.items() if name.endswith(ending)} | shared
    own = axis_excitations(signals.excitations, axis)
    elsewhere = np.setdiff1d(lines_at(signals.excitations), lines_at(own))
    gains = signals.gains and of_axis(signals.gains, axis)
    return replace(signals, channels=channels, excitations=own, gains=gains, axes=1, axis=axis, elsewhere=elsewhere)


def record_spectra(signals: RecordedSignals) -> RecordSpectra:
    """Line statistics of one recording, with the hold of the force's converter removed.

    A periodic recording gives every harmonic up to the highest excited one, over its steady periods. Another one gives
    the lines of `local_polynomial` with respect to the channel that holds its excitation.

    Raises:
        ValueError: Nothing is excited, or several excitations are not periodic.
    """
    if all(e.kind == "none" for e in signals.excitations):
        raise ValueError("nothing is excited along this axis: there is no response to it")
    if signals.periodic:
        statistics, dropped, rest, tones, fast = _periodic(signals)
        driven = {place: lines_at(signals.excitations, place) for place in PLACES}
    else:
        recorded = [e for e in signals.excitations if e.kind == "recorded"]
        if len(recorded) != 1:
            raise ValueError(f"{len(recorded)} recorded excitations: responses need exactly one, or a periodic one")
        statistics, dropped, rest, tones, fast = _aperiodic(signals, recorded[0]), 0, 0, (), 0.0
        driven = {place: statistics.lines[: None if place == recorded[0].at else 0] for place in PLACES}
    force = statistics.at_lines(driven["force"])
    if signals.hold_rate:
        for name in force.channels:
            force = held(force, name, signals.hold_rate) if name.partition("_")[0] == "force" else force
    return RecordSpectra(statistics, force, driven, dropped, rest, tones, fast)


def _stacked(signals: RecordedSignals) -> tuple[tuple[str, ...], np.ndarray]:
    names = tuple(n for n in signals.channels if n.partition("_")[0] in ANALYSED)
    return names, np.stack([signals.channels[n] for n in names])


def _periodic(signals: RecordedSignals) -> tuple[LineStatistics, int, int, tuple[Tone, ...], float]:
    periodic = [e for e in signals.excitations if e.periodic]
    per_period, every = periodic[0].block(signals.sample_rate)
    names, stack = _stacked(signals)
    driven = np.union1d(lines_at(periodic), signals.elsewhere)
    lines = np.arange(1, driven.max() + 1)
    # By another clock no period is whole, and every line leaks onto its neighbours in every period alike.
    fast = 0.0
    if not signals.left_out and SAMPLES * driven.max() * every <= per_period:
        stack, fast = corrected(stack, names, periodic, (per_period, every))
    # What was bridged in a masked period is left out before the transient is looked for.
    periods = np.delete(split_periods(stack, per_period), list(signals.left_out), axis=0)
    moved = [i for i, name in enumerate(names) if name.partition("_")[0] == "displacement"]

    whole = bool(moved) and not signals.left_out  # periods that do not follow one another hold no tone of one phase

    def without_tones(some: np.ndarray) -> tuple[np.ndarray, list[Tone]]:
        cleaned, found = _without_tones(some, names, signals.sample_rate) if whole else (some, [])
        return np.stack([period_spectra(p, lines * every) for p in cleaned]), found

    spectra, found = without_tones(periods)  # a tone beside a line would look like a transient
    on = np.isin(lines, driven)
    dropped = transient_periods(spectra[:, moved][..., on].reshape(len(spectra), -1))
    if dropped:  # beside which a tone does not stand out
        spectra, found = without_tones(periods[dropped:])
    if len(spectra) == 2 and any(two_unsteady(spectra[:, i, on]) for i in moved):
        raise ValueError(UNSTEADY)
    statistics = line_statistics(spectra, periodic[0].fundamental, lines, names)
    for tone in found:
        amplitude = np.concatenate(list(tone.amplitude.values()))
        if tone.frequency < statistics.frequency[-1] + periodic[0].fundamental / 2:
            statistics = beside_tone(statistics, tone, amplitude, moved, per_period / signals.sample_rate)
    return statistics, dropped, stack.shape[1] % per_period, tuple(found), fast


def _without_tones(periods: np.ndarray, names: Sequence[str], rate: float) -> tuple[np.ndarray, list[Tone]]:
    """Periods (P, channels, samples) without tones that do not repeat with them, and those tones.

    A tone such as that of a turning rotor is no noise: near a line it hardly differs from period to period, and on the
    lines around it is as large as it is far away, so that the scatter over periods tells too little of it.
    """
    count, _, samples = periods.shape
    whole = periods.transpose(1, 0, 2).reshape(len(names), -1)
    # One channel for each kind, with its axes, as all of them are removed at one frequency.
    kinds = list(dict.fromkeys(name.partition("_")[0] for name in names))
    order = [[i for i, name in enumerate(names) if name.partition("_")[0] == kind] for kind in kinds]
    cleaned, found = remove_tones(dict(zip(kinds, (whole[own] for own in order), strict=True)), samples, rate, FURTHER)
    # As many as were looked for: a clock or a gain that drifts shows beside every driven line.
    alone = len(found) < MOST and all(stands_alone(cleaned["displacement"], tone, samples, rate) for tone in found)
    if not alone:
        return periods, []
    back = np.argsort(np.concatenate(order))
    values = np.concatenate([cleaned[kind] for kind in kinds])[back].reshape(len(names), count, samples)
    ordered = [replace(tone, amplitude={"all": np.concatenate(list(tone.amplitude.values()))[back]}) for tone in found]
    return values.transpose(1, 0, 2), ordered


def _aperiodic(signals: RecordedSignals, excitation: Excitation) -> LineStatistics:
    names, stack = _stacked(signals)
    name = SHOWN_BY[excitation.at]
    if signals.axes == 2:
        shares = zip(excitation.components, AXES, strict=True)
        parts = [c * _channel(signals, f"{name}_{axis}") for c, axis in shares]
        reference: str | np.ndarray = parts[0] + parts[1]
    elif name in names:
        reference = name
    else:
        reference = _channel(signals, name)
    return local_polynomial(stack, names, signals.sample_rate, reference, excitation.band)


def _channel(signals: RecordedSignals, name: str) -> np.ndarray:
    if name not in signals.channels:
        raise ValueError(f"the recorded excitation needs the channel {name}: its waveform is that channel")
    return signals.channels[name]
