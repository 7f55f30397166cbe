"""One data file of unknown origin as a recording of a campaign: every guess with its evidence."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from maglev_env.channels import SHOWN_BY
from maglev_env.recordings.contents import Contents, contents
from maglev_env.recordings.files import read_columns
from maglev_env.recordings.guess.behaviour import of_one_sign
from maglev_env.recordings.guess.columns.column_guess import ColumnGuess
from maglev_env.recordings.guess.columns.columns import guess_columns
from maglev_env.recordings.guess.controllers import asked_of, controllers, rescaled
from maglev_env.recordings.guess.evidence import LIKELY, OPEN, STATED, Guess
from maglev_env.recordings.guess.excitation import guess_excitation
from maglev_env.recordings.guess.gaps import whole
from maglev_env.recordings.guess.rate import STATED_RATE, guess_rate, jitter_of
from maglev_env.recordings.guess.unfitting_time import unfitting_times
from maglev_env.recordings.guess.unread import unread_columns
from maglev_env.recordings.masking import MOST_MASKED, clipped_samples

ALARM = "alarm: "  # how a note begins that names a fault of the recording
_CARRIES = 2.0  # mean current over its standard deviation that holds a weight


@dataclass(frozen=True)
class RecordingGuess:
    """What a file holds.

    Args:
        file: its name, relative to the campaign.
        columns: a guess for each of its columns.
        rate: sample rate, Hz.
        excitation: tables of the excitation, and the evidence.
        excitations: the tables themselves.
        controller: what the command says of the controller.
        gains: as a campaign takes them; None where they are not known.
        form: a controller of another form, as a campaign takes it; None where there are gains, or none is known.
        jitter: rms of the steps of its time, as a share of one; 0 without a time.
        rotor: "suspended" or "supported", or None.
        speed_rpm: speed of rotation that a column shows in every sample, 1/min.
        notes: what else was seen.
        part: first sample that is used, and how many; None: the whole file.
        unread: columns that seem to hold numbers and could not be read, and why.
    """

    file: str
    columns: tuple[ColumnGuess, ...]
    rate: Guess
    excitation: Guess
    excitations: tuple[Mapping[str, Any], ...]
    controller: Guess
    gains: Mapping[str, float] | None
    rotor: Guess
    notes: tuple[str, ...] = ()
    part: tuple[int, int] | None = None
    form: Mapping[str, Any] | None = None
    jitter: float = 0.0
    speed_rpm: float = 0.0
    unread: Mapping[str, str] = field(default_factory=dict)

    @property
    def channels(self) -> dict[str, ColumnGuess]:
        """The columns that are used, by channel."""
        return {c.channel: c for c in self.columns if c.channel}

    @property
    def labels(self) -> list[str]:
        """What the file calls its columns."""
        return [c.label for c in self.columns]

    @property
    def guesses(self) -> list[Guess]:
        """All guesses of this file."""
        columns = [Guess(f"column {c.column}", c.channel or None, c.reason, c.confidence, c.ask) for c in self.columns]
        return [*columns, self.rate, self.excitation, self.controller, self.rotor]

    def table(self) -> dict[str, Any]:
        """The [[recording]] of a campaign; its sample rate is 0 where it is not known."""
        table: dict[str, Any] = {"file": self.file, "role": "fit", "sample_rate": self.rate.value or 0.0}
        if self.part:
            table["start"], table["samples"] = self.part
        if self.speed_rpm:
            table["speed_rpm"] = self.speed_rpm
        if self.gains:
            table["gains"] = dict(self.gains)
        if self.form:
            table["controller"] = dict(self.form)
        table["excitation"] = [dict(e) for e in self.excitations]
        table["channels"] = {name: c.source for name, c in self.channels.items()}
        return table


def guess_recording(
    path: Path,
    folder: Path | None = None,
    rate: float | None = None,
    part: tuple[int, int] | None = None,
    columns: tuple[ColumnGuess, ...] | None = None,
    channels: Mapping[str, str] | None = None,
) -> RecordingGuess:
    """Guess everything that a campaign needs of one data file.

    Args:
        path: the file.
        folder: the campaign's folder; None: that of the file.
        rate: sample rate in Hz where the user states it.
        part: first sample that is used, and how many; None: the whole file.
        columns: what its columns are, where that is known; None: guessed.
        channels: what the user states of some columns, see `guess_columns`.

    Returns:
        The guesses.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is no data file, or holds no columns, or the stated rate is none.
    """
    if rate is not None and not 0 < rate < inf:
        raise ValueError(f"{path}: a sample rate of {rate:g} Hz: it must be positive and finite")
    file = read_columns(path)
    found = contents(file)
    if rate is not None:  # it tells the unit of a time without one, too
        found = replace(found, numbers={STATED_RATE: rate} | found.numbers | {STATED_RATE: rate})
    if part:
        used = slice(part[0], part[0] + part[1])
        bridged = None if found.bridged is None else found.bridged[used]
        found = replace(found, columns={n: values[used] for n, values in found.columns.items()}, bridged=bridged)
    columns = guess_columns(found, channels) if columns is None else columns
    by_channel = {c.channel: c.values(found.columns) for c in columns if c.channel}
    time = next((c for c in columns if c.channel == "time"), None)
    guessed = guess_rate(found.columns[time.column] if time else None, time.scale if time else 1.0, found.numbers,
                         time.label if time else "time")  # fmt: skip
    if rate is not None:
        guessed = Guess("sample_rate", rate, f"{rate:g} Hz: stated", STATED)
    if time and guessed.value is None:  # a counter: no time
        columns = tuple(replace(c, channel="", reason=guessed.reason) if c is time else c for c in columns)
    unfitting = unfitting_times(columns, found, rate) if rate else []
    signals = {n: v for n, v in by_channel.items() if n != "time"}
    tables, excitation = guess_excitation(signals, guessed.value)
    tables = [_without_peak(table, columns) for table in tables]
    clock = by_channel.get("time") if guessed.value else None
    gains, form, controller = controllers(*whole(by_channel, clock, _unread(found, columns)), guessed.value)
    return RecordingGuess(
        file=path.name if folder is None else path.resolve().relative_to(folder.resolve()).as_posix(),
        columns=columns,
        rate=guessed,
        excitation=excitation,
        excitations=tuple(tables),
        controller=controller,
        gains=gains,
        rotor=_rotor(by_channel, any(c.less for c in columns)),
        notes=(*file.notes, *found.unused, *(f"{ALARM}{said}" for said in unfitting)),
        part=part,
        form=form,
        jitter=0.0 if clock is None else jitter_of(clock),
        speed_rpm=_turning(columns, found),
        unread=unread_columns(found.unused),
    )


def _turning(columns: tuple[ColumnGuess, ...], found: Contents) -> float:
    """The speed that a column shows in every sample, 1/min; 0 without one, or where its unit is not known."""
    held = [abs(found.columns[c.column][0] * c.scale) for c in columns if c.resting == "speed" and not c.ask]
    return float(f"{held[0] * 30 / np.pi:.6g}") if held else 0.0


def _unread(found: Contents, columns: tuple[ColumnGuess, ...]) -> np.ndarray:
    """Samples (samples,) at which a position was bridged, or is clipped in the file alone."""
    moved = [found.columns[c.column] for c in columns if c.channel.startswith("displacement")]
    size = next(iter(found.columns.values())).size
    clipped = [at for values in moved if 0 < (at := clipped_samples(values)).mean() <= MOST_MASKED]
    return np.any([np.zeros(size, bool) if found.bridged is None else found.bridged, *clipped], axis=0)


def _without_peak(table: Mapping[str, Any], columns: tuple[ColumnGuess, ...]) -> dict[str, Any]:
    """An excitation without its peak, where that would have to follow a scale that is still to be stated."""
    channel = SHOWN_BY[table["at"]] if "at" in table else ""
    open_ = any(c.channel.removesuffix("_x").removesuffix("_y") == channel and "scale in" in c.ask for c in columns)
    return {key: value for key, value in table.items() if key != "amplitude" or not open_}


def other_way_round(guess: RecordingGuess) -> RecordingGuess:
    """The guess with the gains of a controller whose displacement now counts in the other direction."""
    return in_another_unit(guess, -1.0)


def in_another_unit(guess: RecordingGuess, factor: float) -> RecordingGuess:
    """The guess with the gains of a controller whose displacement's scale has changed by a factor."""
    if guess.form:
        form = rescaled(guess.form, factor)
        return replace(guess, form=form, controller=replace(guess.controller, value=form, ask=asked_of(form)))
    if not guess.gains:
        return guess
    gains = rescaled(guess.gains, factor)
    return replace(guess, gains=gains, controller=replace(guess.controller, value=gains, ask=asked_of(gains)))


def _rotor(channels: Mapping[str, np.ndarray], opposed: bool) -> Guess:
    """Whether the currents of its channels (samples,), or what opposed coils are there, show a rotor that hangs."""
    ask = "whether the rotor hangs below a magnet or is supported"
    if opposed:  # the mean of their difference may carry the weight, but the bias is not in it
        return Guess("rotor", "supported", "the currents of two opposed coils: a pair of magnets", LIKELY, "")
    for name, unit in (("current", "A"), ("command", "A"), ("current_x", "A"), ("command_x", "A"), ("voltage", "V")):
        if name in channels:
            values = channels[name]
            mean, spread = float(values.mean()), float(values.std())
            if spread and of_one_sign(values):
                reason = f"{name} from {values.min():.3g} to {values.max():.3g} {unit}, of one sign: a single magnet"
                return Guess("rotor", "suspended", reason, LIKELY, ask)
            if abs(mean) > _CARRIES * spread:
                ratio = f"{abs(mean) / spread:.1f} times" if spread else "without"
                reason = f"mean {name} {mean:.3g} {unit}, {ratio} its standard deviation: it may carry a weight"
                return Guess("rotor", "suspended", reason, OPEN, ask)
            reason = f"mean {name} {mean:.3g} {unit}, less than {_CARRIES:g} standard deviations: "
            reason += "a pair of magnets, or a support, carries the weight"
            return Guess("rotor", "supported", reason, OPEN, ask)
    if "force" in channels:
        return Guess("rotor", "supported", "a force and no current: nothing seems to levitate it", OPEN, ask)
    return Guess("rotor", None, "neither current nor force", 0.0, ask)
