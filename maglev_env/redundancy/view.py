"""One axis of one recording as the rules look at it: channels, what is stated of them, and their spectra."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimation.lines.periods import period_spectra, split_periods, transient_periods
from maglev_env.experiment import Experiment, sampling
from maglev_env.linear.loop import LoopResponse, loop_response
from maglev_env.loop.gains import NO_CONTROLLER, Controller
from maglev_env.rig.excitation import Excitation, lines_at
from maglev_env.rig.rig import Rig

SEGMENTS, SHORTEST, LONGEST = 16, 256, 8192  # of a record without a period, and samples of one
MOST_BINS, TOP = 300, 0.25  # bins of a segment, and the highest as a share of the rate
KINDS = ("displacement", "command", "current", "force", "injection", "reference")


@dataclass(frozen=True)
class Lines:
    """Spectra of the steady part of a recording.

    Attributes:
        frequency: (n,), Hz.
        parts: Spectra (s, n) of each period, or of each windowed segment where nothing repeats, by channel.
        periodic: Which of the two.
        harmonics: (n,) harmonic numbers; empty where nothing repeats.
        first: First period used.
    """

    frequency: np.ndarray
    parts: Mapping[str, np.ndarray]
    periodic: bool
    harmonics: np.ndarray
    first: int = 0

    def at(self, keep: np.ndarray) -> "Lines":
        """The same channels at some of the lines: where a mask is True, or at indices."""
        harmonics = self.harmonics[keep] if self.periodic else self.harmonics
        return Lines(
            self.frequency[keep], {k: v[:, keep] for k, v in self.parts.items()}, self.periodic, harmonics, self.first
        )


@dataclass(frozen=True)
class View:
    """One axis of one recording.

    Attributes:
        recording: For sentences: the file, and its axis where it has two.
        rate: Of the channels, Hz.
        channels: (samples,) in SI, by one-axis names.
        recorded: Channels that stand in the file.
        columns: Column of the file of each recorded channel.
        excitations: Along this axis.
        stated_peaks: Places whose amplitude the campaign states.
        gains: Controller, None without one.
        others: Other controllers of the campaign.
        rig: Of this axis; None where the campaign names none.
        mass: Moving mass, kg; None where it is not stated.
        hold_rate: See `RecordedSignals`.
        left_out: Periods with masked samples.
        corrected: Channels of which the campaign states a filter or delay, which is taken off.
        masked: Samples (samples,) that are bridged; None: none is.
        railed: Channels that stayed at an extreme value for some samples.
    """

    recording: str
    rate: float
    channels: Mapping[str, np.ndarray]
    recorded: frozenset[str]
    columns: Mapping[str, str]
    excitations: tuple[Excitation, ...]
    stated_peaks: frozenset[str]
    gains: Controller | None
    others: tuple[Controller, ...]
    rig: Rig | None
    mass: float | None
    hold_rate: float | None = None
    left_out: tuple[int, ...] = ()
    corrected: frozenset[str] = frozenset()
    masked: np.ndarray | None = None
    railed: frozenset[str] = frozenset()

    @property
    def periodic(self) -> bool:
        return any(e.periodic for e in self.excitations)

    @property
    def amplifier_open(self) -> bool:
        """Whether the rig leaves the amplifier's time constant out, and does not state 0 for its tolerance."""
        rig = self.rig
        return rig is not None and not rig.amplifier_time_constant and rig.tolerance.get("amplifier_time_constant") != 0

    @property
    def block(self) -> tuple[int, int]:
        """Samples and periods of the smallest whole block."""
        return next(e for e in self.excitations if e.periodic).block(self.rate)

    @cached_property
    def blocks(self) -> tuple[tuple[str, ...], np.ndarray]:
        """Channels, and their blocks (blocks, channels, samples) with whole periods."""
        names = tuple(name for name in KINDS if name in self.channels)
        return names, split_periods(np.stack([self.channels[name] for name in names]), self.block[0])

    @cached_property
    def lines(self) -> Lines:
        """Spectra of what is driven along this axis."""
        return self._driven() if self.periodic else self._segments()

    def place(self, place: str) -> np.ndarray:
        """Which of the lines an excitation at a place drives, (n,) bool."""
        return np.isin(self.lines.harmonics, lines_at(self.excitations, place))

    def _driven(self) -> Lines:
        _, every = self.block
        names, blocks = self.blocks
        kept = [p for p in range(len(blocks)) if p not in self.left_out]
        harmonics = lines_at(self.excitations)
        spectra = np.stack([period_spectra(blocks[p], harmonics * every) for p in kept])
        first = transient_periods(spectra[:, names.index("displacement")]) if "displacement" in names else 0
        # The first period may hold the start of the excitation, which few periods cannot tell.
        first = max(first, 1 if len(spectra) > 2 else 0)
        fundamental = next(e.fundamental for e in self.excitations if e.periodic)
        steady = _without_drift(spectra[first:], blocks[kept[first:]].mean(axis=-1), kept[first:], harmonics * every)
        parts = {name: steady[:, i] for i, name in enumerate(names)}
        return Lines(harmonics * fundamental, parts, True, harmonics, kept[first])

    def _segments(self) -> Lines:
        names = [name for name in KINDS if name in self.channels]
        samples = self.channels[names[0]].size
        length = int(np.clip(2 ** int(np.log2(max(samples / SEGMENTS, 1))), SHORTEST, LONGEST))
        if samples < length:  # too short to tell anything
            return Lines(np.zeros(0), {name: np.zeros((1, 0)) for name in names}, False, np.zeros(0, int))
        starts = np.arange(0, samples - length + 1, length // 2)
        window = np.hanning(length + 1)[:-1]
        bins = np.unique(np.geomspace(3, TOP * length, MOST_BINS).astype(int))
        parts = {}
        for name in names:
            x = self.channels[name]
            cut = np.stack([x[s : s + length] - x[s : s + length].mean() for s in starts])
            parts[name] = np.fft.rfft(cut * window, axis=-1)[:, bins]
        return Lines(bins * self.rate / length, parts, False, np.zeros(0, int))

    @cached_property
    def known_drive(self) -> bool:
        """Whether what is added to the command is recorded or designed."""
        return "injection" in self.channels or "reference" in self.channels or self.periodic

    def nominal(self, frequency: np.ndarray, gains: Controller | None = None) -> LoopResponse:
        """The nominal loop under these or the stated gains."""
        assert self.rig is not None
        return loop_response(Experiment(self.rig, gains or self.gains or NO_CONTROLLER, ()), frequency)

    def at_control_rate(self) -> "View":
        """The control samples of a faster recording; others as they are."""
        if self.rig is None:
            return self
        try:
            multiple, _ = sampling(self.rate, self.rig.control_rate)
        except ValueError:
            return self
        if multiple == 1:
            return self
        channels = {name: values[::multiple] for name, values in self.channels.items()}
        masked = None if self.masked is None else self.masked[::multiple]
        return replace(self, rate=self.rate / multiple, channels=channels, masked=masked)


def _without_drift(spectra: np.ndarray, means: np.ndarray, at: Sequence[int], lines: np.ndarray) -> np.ndarray:
    """Spectra of blocks (blocks, channels, n) without the slope by which the means of the blocks follow each other.

    What drifts does not repeat: the step from the end of a block to its beginning is in all its lines, the lowest above
    all, which a high-pass would take away.

    Args:
        spectra: Amplitudes of lines.
        means: Of the blocks (blocks, channels).
        at: Numbers of the blocks, in order.
        lines: Harmonic numbers (n,) of a block.
    """
    if len(means) < 2:
        return spectra
    # A ramp of one a block has the amplitude j / (pi h) on its harmonic h.
    return spectra - np.gradient(means, at, axis=0)[..., None] * (1j / (np.pi * lines))
