"""A recording that never repeats, as evidence: set-point steps, a chirp, noise that nobody stored, one sine, hover.

Where the logged displacement is what the controller read, what was added to its command is known exactly, sensor noise
included: w = command - C(reference, -displacement, -current), with C the controller's own recursion. The closed loop of
a hypothesis is simulated under this w. Its reading differs from the recorded one by the loop's answer to the sensor
noise, to what else disturbs it and to the unknown start. Opened at the fixed nominal loop (see `opened`), the
differences of reading and current are white for white sensor noise, each its own, and are looked at in windows of lines
with the transient projected out (`estimation.lines.line_windows`). Data and simulation go through the same linear map.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.fft

from estimation.lines.line_windows import KEPT, POOLED, WIDTH, LineWindows
from estimation.lines.tones import Tone
from maglev_env.experiment import Experiment
from maglev_env.kernel.driven import Drive
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.recordings.left_out import TellsNothing
from maglev_env.rig.rig import Rig
from sim2real.recorded.along_motion import AlongMotion
from sim2real.recorded.at_rest.static_evidence import Rests
from sim2real.recorded.at_rest.weight_law import lacking_in_words
from sim2real.recorded.channel_errors import ChannelError
from sim2real.recorded.static_load import Load

SETTLING = 8.0  # time constants of the nominal closed loop that are simulated but not compared
LONGEST_SETTLING = 0.2  # of a record
# Samples that all recordings of a campaign have together, and that each may have in any case: a longer record is
# compared over its stretch that is driven most.
TOGETHER, EACH = 120_000, 30_000
TOP = 0.4  # of the control rate: highest frequency that is compared
FOUR_SIGMA = 4.0
DUST = 1e-8  # of the power in the strongest window: what is left of rounded columns, which goes with the noise
# Multiples of the power that the noise of its sensor has on a line: what a line of a measured force exceeds hardly ever
# by noise alone, and what the median of a window stays below.
STANDS_OUT, BROAD = 9.0, 1.5
UNSURE_OF_GAINS = 1e-6  # of a command's power in a window: a drive is not known better than the gains that it needs
TELLING = 0.01  # of the noise: above the last window in which what drives the loop moves it as much nothing is compared


@dataclass(frozen=True)
class OpenRecord:
    """One recording without a period; it stands beside `records.Record` wherever evidence is looked at.

    Args:
        name, role: as the campaign has them.
        nominal: the rig as the campaign states it.
        experiment: the rig without noise and converters, under this recording's gains.
        waves: place -> (axes, samples * every) of what drives the simulation, at the control rate of the experiment.
        series: channel -> (axes, samples) of displacement and, where it is compared, current.
        command: (axes, samples), recorded or computed from the other channels; zeros without a controller.
        added: (axes, samples), what of the command does not depend on the readings: the injection, and what the
            reference causes.
        first: samples that are simulated but not compared.
        windows: lines that are compared.
        every: control samples of the experiment for each recorded sample.
        upstream: effects that act before what drives the simulation, and therefore do not show in this recording.
        errors: what may be wrong with its channels.
        source: channel from which the injection follows, "command" or "current"; None: none.
        rests: what its means say of a suspended mass; None: nothing.
        lacks: what the mean of its source lacked of carrying the weight, A, and was added, because nobody says how well
            the zeros of the channels are known; None: the mean is evidence, or there is no weight.
        load: with which a rotor between opposed magnets is simulated to rest where it was recorded; None: none.
        bias: (axes, n), what noise in the drive may add to the opened displacement; None: nothing.
        unsure: name -> (axes, n), standard deviations of that bias; one of the same name is the same in all recordings.
        told: (n,) whether a coordinate is compared; None: all are.
        instrument: (inputs, windows, WIDTH), spectra of reference and injection, in whose direction alone is compared;
            None: in all directions.
        tones: sinusoids that nothing which drives the record explains; their amplitude "opened" (axes,) is that of the
            opened displacement, m.
        along: what gain and stiffness of the magnets differ along its motion, over what is compared; None: nothing.
        smoothed: order -> standard deviation (s^order) of the terms of what undoes the filter of the whole log.
        instants: (samples * every,), of the control samples in control steps; None: one step after another.
        notes: what was assumed.
    """

    name: str
    role: str
    nominal: Rig
    experiment: Experiment
    waves: Mapping[str, np.ndarray]
    series: Mapping[str, np.ndarray]
    command: np.ndarray
    added: np.ndarray
    first: int
    windows: LineWindows
    every: int = 1
    upstream: frozenset[str] = frozenset()
    errors: tuple[ChannelError, ...] = ()
    source: str | None = None
    rests: Rests | None = None
    lacks: float | None = None
    load: Load | None = None
    bias: np.ndarray | None = None
    unsure: Mapping[str, np.ndarray] = field(default_factory=dict)
    told: np.ndarray | None = None
    instrument: np.ndarray | None = None
    tones: tuple[Tone, ...] = ()
    along: AlongMotion | None = None
    smoothed: Mapping[int, float] = field(default_factory=dict)
    instants: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    dropped = 0

    @property
    def axes(self) -> int:
        return self.experiment.rig.axes

    @property
    def off_balance(self) -> str | None:
        """What its mean lacks of carrying the weight, where that is much but no evidence, as a clause."""
        return (
            None if self.lacks is None or not self.source else lacking_in_words(self.nominal, self.source, self.lacks)
        )

    @property
    def slower_than_controller(self) -> bool:
        """Whether it holds fewer samples than its controller took."""
        return self.nominal.control_rate > (1 + 1e-9) * self.windows.sample_rate

    @property
    def count(self) -> int:
        """Periods kept, as it were."""
        return 1

    @cached_property
    def frequency(self) -> np.ndarray:
        """Middle of the window of each coordinate (n,), Hz."""
        return np.repeat(self.windows.centre, KEPT)

    @property
    def lines(self) -> np.ndarray:
        """Numbers (n,) of the coordinates."""
        return np.arange(self.frequency.size)

    @property
    def masked(self) -> np.ndarray:
        return np.zeros(self.frequency.size, bool)

    @cached_property
    def driven(self) -> Mapping[str, np.ndarray]:
        """Place -> (axes, n) whether a coordinate is driven there."""
        return {place: np.repeat(np.ptp(w, axis=1) > 0, self.frequency.size).reshape(self.axes, -1)
                for place, w in self.waves.items()}  # fmt: skip

    @property
    def excited(self) -> np.ndarray:
        return np.ones(self.frequency.size, bool) if self.told is None else self.told

    @cached_property
    def periods(self) -> Mapping[str, np.ndarray]:
        """Channel -> (1, axes, n), its coordinates."""
        return {name: self.coordinates(values)[None] for name, values in self.series.items()}

    def mean(self, channel: str) -> np.ndarray:
        return self.periods[channel][0]

    def driving(self, place: str) -> np.ndarray:
        """Coordinates (axes, n) of what drives the rig at "force" (N), "current" (A) or "reference" (m)."""
        return self.coordinates(self.waves[place][:, :: self.every])

    @property
    def drive(self) -> Drive:
        """What its simulation runs under."""
        return Drive(self.experiment, self.waves, self.instants, self.load)

    @cached_property
    def drives(self) -> np.ndarray:
        """Spectra (inputs, windows, WIDTH) of what drives the record: of all that varies in the simulation's drive, or
        of what of it is free of noise.

        What is left of a command beyond that of the stated controller is zero in windows in which it is next to nothing
        of the command: there it is what the stated gains are off by, times the very noise that it would explain. So is
        a measured force on lines on which it is the noise of its sensor: the rotor did not feel that, so all that the
        simulation makes of it would be left along it.
        """
        if self.instrument is not None:
            return self.instrument
        found = {place: self.spectrum(waves[:, :: self.every]) for place, waves in self.waves.items()}
        if self.source is not None:
            own, whole = map(self.windows.power, (found["current"], self.spectrum(self.command)))
            found["current"] = np.where((own > UNSURE_OF_GAINS * whole)[..., None], found["current"], 0.0)
        if (stated := self.nominal.noise.force) > 0:
            felt = self.windows.cleared(found["force"])
            power = np.abs(felt) ** 2 / ((2 * stated) ** 2 / self.windows.samples)
            broad = np.median(power, axis=-1, keepdims=True) > BROAD
            found["force"] = np.where((power > STANDS_OUT) | broad, felt, 0.0)
        moving = [lines for place, waves in self.waves.items() for lines in found[place][np.ptp(waves, axis=1) > 0]]
        return np.stack(moving) if moving else next(iter(found.values()))[:1]

    def spectrum(self, series: np.ndarray) -> np.ndarray:
        """Lines (..., windows, WIDTH) of series (..., samples) over the part that is compared."""
        return self.windows.spectrum(series[..., self.first : self.first + self.windows.samples])

    def coordinates(self, series: np.ndarray) -> np.ndarray:
        """Coordinates (..., n) of series (..., samples): lines without transient and drift."""
        found = self.windows.project(self.spectrum(series))
        return found.reshape(*found.shape[:-2], -1)


def along_instrument(record: object) -> bool:
    """Whether a record is compared in the direction of its instrument alone."""
    return isinstance(record, OpenRecord) and record.instrument is not None


@dataclass(frozen=True)
class Stretch:
    """The part of a recording that is simulated from `start` on, of which the first `settling` samples are not
    compared, and the windows of the rest."""

    start: int
    settling: int
    windows: LineWindows
    notes: tuple[str, ...] = ()

    @property
    def samples(self) -> slice:
        return slice(self.start, self.start + self.settling + self.windows.samples)


def most_samples(e: Experiment, rate: float, recordings: int) -> int:
    """Samples of a recording that are compared at most.

    Args:
        e: the nominal experiment.
        rate: of the recording, Hz.
        recordings: how many the campaign has.
    """
    return int(max(EACH, TOGETHER // recordings) * rate / e.rig.control_rate)


def compared(e: Experiment, rate: float, driven: np.ndarray, displacement: np.ndarray, recordings: int) -> Stretch:
    """What of a recording is compared.

    Args:
        e: the nominal experiment.
        rate: of the recording, Hz.
        driven: (inputs, samples), what drives it: forces (N), injections (A) and references (m) of each axis.
        displacement: (axes, samples), the reading.
        recordings: how many the campaign has.

    Raises:
        TellsNothing: the recording is too short for windows of lines.
    """
    samples, longest = driven.shape[1], most_samples(e, rate, recordings)
    radius = float(abs(closed_loop_poles(e)).max()) ** (e.rig.control_rate / rate)
    most = int(LONGEST_SETTLING * min(samples, longest))
    settling = most if radius >= 1 else min(int(np.ceil(SETTLING / -np.log(radius))), most)
    start, length, notes = 0, samples - settling, []
    if length > longest:
        moved = driven - driven.mean(axis=1, keepdims=True)
        energy = np.cumsum(np.sum(moved**2 / np.maximum(moved.var(axis=1, keepdims=True), 1e-300), axis=0))
        begin = np.arange(settling, samples - longest + 1, max(longest // 50, 1))
        start = int(begin[np.argmax(energy[begin + longest - 1] - energy[begin])]) - settling
        length = longest
        notes.append(
            f"of {samples / rate:.3g} s the {length / rate:.3g} s from {(start + settling) / rate:.3g} s on are "
            "compared, in which the loop is driven most"
        )
    # Thousands of simulations are transformed: a length of small factors takes a third of the time. What it leaves out
    # is given to the settling.
    fast = scipy.fft.prev_fast_len(length)
    settling, length = settling + length - fast, fast
    count = int((TOP * length - 1) // WIDTH)
    if count < POOLED:
        least = int(WIDTH * (POOLED + 1) / TOP) + settling
        raise TellsNothing(f"{samples} samples are too few to compare", f"record at least {least}")
    whole = LineWindows(length, rate, 1, count)
    kept = slice(start + settling, start + settling + length)
    drives = whole.spectrum(driven[:, kept])
    told = whole.noise(whole.spectrum(displacement[:, kept]), drives)
    share = (told.explained / np.maximum(told.rank, 1) / np.maximum(told.variance, 1e-300) - 1).max(axis=0)
    smooth = np.convolve(share, np.ones(POOLED) / POOLED, "same")
    chance = FOUR_SIGMA / np.sqrt(POOLED * np.maximum(told.rank, 1))  # what noise alone explains by chance
    power = whole.power(drives)  # a jump between the ends is no drive
    drives_it = (power > DUST * power.max(axis=-1, keepdims=True)).any(axis=0)
    telling = np.flatnonzero(drives_it & (smooth > np.maximum(TELLING, chance)))
    last = max(int(telling[-1]) if telling.size else count - 1, POOLED - 1)
    return Stretch(start, settling, replace(whole, count=last + 1), tuple(notes))
