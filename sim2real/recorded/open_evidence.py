"""What an open record says and what a hypothesis predicts of it, as coordinates of the opened loop with their noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy.fft

from estimation.lines.line_windows import KEPT, WIDTH
from maglev_env.experiment import Experiment
from maglev_env.kernel.blocks import Block
from maglev_env.kernel.replay import look_at_replays, replayed
from sim2real.recorded.channel_errors import BY_MOTION, ChannelError
from sim2real.recorded.noise_response import NoiseResponse
from sim2real.recorded.open_loop import Loop
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import Opened
from sim2real.recorded.ringing import driven_directions, ringing_directions, without
from sim2real.recorded.tones import tone_lines, without_tone

FORCE = 2  # place of the force's noise among the shapes of noise
SMALL = 0.1  # of an error, for its direction: in proportion, and yet well above rounding


def opened_of(loop: Loop) -> Opened:
    """The nominal blocks at the middle of each coordinate's window, in the form that periodic records have."""
    blocks = [np.reshape(getattr(loop.blocks, f.name), (-1, *loop.shape)) for f in fields(Opened)[:-1]]
    return Opened(*(np.repeat(v[..., WIDTH // 2], KEPT, axis=-1) for v in blocks), loop.blocks.outputs)


def simulated_series(record: OpenRecord, lanes: list[Block]) -> np.ndarray:
    """Displacement, current and command (n, 3, axes, samples) of prepared lanes at the recorded samples; nan where they
    touch down."""
    (found,) = replayed(lanes, [record.drive])
    return found[..., :: record.every]


@dataclass(frozen=True)
class Replay:
    """Predicts the coordinates of an open record: its closed loop, simulated under what drove it."""

    record: OpenRecord
    loop: Loop
    outputs: tuple[str, ...]
    response: NoiseResponse | None = None  # to noise in its drive; None: it is not told

    def coordinates(self, series: np.ndarray) -> np.ndarray:
        """Coordinates (outputs, axes, n) of a simulation's displacement, current and command (3, axes, samples)."""
        found = coordinates_of(self.record, self.loop, self.outputs, series)
        return found if self.response is None else self.response.without(found)


def coordinates_of_lanes(replays: Sequence[Replay], lanes: list[Block]) -> list[np.ndarray]:
    """(n, outputs, axes, coordinates) of prepared lanes, of each record; nan where the rotor touches down."""

    count = sum(len(block.members) for block in lanes)
    found = [np.empty((count, len(r.outputs), r.record.axes, r.record.frequency.size), complex) for r in replays]

    def look(which: int, lane: int, series: np.ndarray) -> None:
        own = replays[which]
        found[which][lane] = own.coordinates(series[..., :: own.record.every])

    look_at_replays(lanes, [own.record.drive for own in replays], look)
    return found


def coordinates_of(record: OpenRecord, loop: Loop, outputs: Sequence[str], series: np.ndarray) -> np.ndarray:
    """Opened coordinates (outputs, axes, n) of displacement, current and command (3, axes, samples)."""
    opened = loop.opened(record, series[0], series[2] - record.added, series[1] if "amplifier" in outputs else None)
    return record.windows.project(opened).reshape(*opened.shape[:2], -1)


def measured_series(record: OpenRecord) -> np.ndarray:
    """Displacement, current (zero where it is not compared) and command, (3, axes, samples)."""
    displacement = record.series["displacement"]
    return np.stack([displacement, record.series.get("current", np.zeros_like(displacement)), record.command])


def measured_of(record: OpenRecord, loop: Loop, outputs: Sequence[str]) -> np.ndarray:
    """Opened coordinates (outputs, axes, n) of what was recorded."""
    return coordinates_of(record, loop, outputs, measured_series(record))


def parts_of(record: OpenRecord, loop: Loop, predicted: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """What each channel adds to the opened residuals, see `channel_errors.changes`, (axes, windows, WIDTH).

    All of it comes from the simulation, which is free of the sensor's noise.

    Args:
        predicted: displacement, current and command (3, axes, samples) of the simulation nearest to the record.
    """
    y, i, command = (record.spectrum(series) for series in predicted)
    blocks = loop.blocks
    plant, amplifier, receptance, referred, controller, from_current = (
        np.reshape(v, (-1, *loop.shape))
        for v in (
            blocks.plant,
            blocks.amplifier,
            blocks.receptance,
            blocks.from_reference,
            blocks.controller,
            blocks.from_current,
        )
    )
    force, injection, reference = (
        record.spectrum(record.waves[place][:, :: record.every]) for place in ("force", "current", "reference")
    )
    found = {
        "displacement": {"plant": y},
        "current": {"amplifier": i},
        "force": {"plant": -receptance * force},
    }
    if record.source == "command":
        found["command"] = {"plant": -plant * command, "amplifier": -amplifier * command}
    elif record.source == "current":
        found["current"], found[BY_MOTION] = {"plant": -plant * command}, {"plant": -plant * y}
    else:
        # Of the readings follows a command that nobody recorded. From a recorded command or current they are taken off
        # again, as what drives the simulation.
        found["displacement"] = {"plant": (1 + plant * controller) * y, "amplifier": amplifier * controller * y}
        found["current"] = {"plant": plant * from_current * i, "amplifier": (1 + amplifier * from_current) * i}
        for channel, own in (("injection", injection), ("reference", referred * reference)):
            found[channel] = {"plant": -plant * own, "amplifier": -amplifier * own}
    return found


def exact_errors(record: OpenRecord) -> list[ChannelError]:
    """The errors of a measured drive whose effect is simulated, see `redriven`; that of the others is `parts_of`.

    Through the closed loop of the stand-in, the effect of a late current is not that on the nominal plant. Where all
    that varies is compared, an exact direction would also take away what `fed_back` corrects.
    """
    return [e for e in record.errors if e.channel == record.source] if record.instrument is not None else []


def redriven(record: OpenRecord, amounts: Mapping[ChannelError, float]) -> OpenRecord:
    """A record that a measured current or command drives, as if errors of that channel were put right, each in this
    amount of its standard deviation; what its readings contribute to the command stays as it is."""
    command, current, added = record.command.copy(), record.waves["current"].copy(), record.added.copy()
    n = command.shape[1]
    for error, amount in amounts.items():
        by = record.series["displacement"] if error.by == BY_MOTION else record.command
        change = _with_factor(by[error.axis], error.whole_factor(_frequencies(record, n), amount))
        current[error.axis] += np.interp(np.arange(n * record.every) / record.every, np.arange(n), change)
        added[error.axis] += change
        command[error.axis] += change
    return replace(record, command=command, waves={**record.waves, "current": current}, added=added)


def smoothed_alike(
    record: OpenRecord, loop: Loop, outputs: Sequence[str], lanes: list[Block], at: np.ndarray
) -> dict[str, np.ndarray]:
    """What a filter of the whole log may change, which smooths its drive and its displacement alike.

    A linear rig makes the smoothed displacement of the smoothed drive. The magnets' pull by squares of current and
    displacement is not that of the smoothed ones: short peaks of the current, which stiffen a pair, are not in the log.
    The rig is simulated under the drive before the filter, and what it makes is filtered.

    Args:
        lanes: prepared ones of the point of comparison.
        at: coordinates (outputs, axes, n) there.

    Returns:
        Name -> change of the coordinates (outputs, axes, n) for one standard deviation of each term of what undoes
        that filter.
    """
    found = {}
    for order, size in record.smoothed.items():
        # Of this sign the filter's inverse is at least 1 at every frequency.
        shape = SMALL * size * (-1.0 if order % 4 == 2 else 1.0)
        sharper = ChannelError(f"filter of the log (order {order})", record.source or "", shape=shape, order=order)
        waves = {**record.waves, "current": _sharpened(record, record.waves["current"], sharper)}
        series = simulated_series(replace(record, waves=waves), lanes)[0]
        if np.isfinite(series).all():
            change = coordinates_of(record, loop, outputs, _filtered(record, series, sharper)) - at
            found[sharper.name] = change / SMALL
    return found


def _sharpened(record: OpenRecord, wave: np.ndarray, error: ChannelError) -> np.ndarray:
    """A wave (axes, samples * every) with an error's factor on what it is at the recorded samples."""
    own = wave[:, :: record.every]
    change = _with_factor(own, error.factor(_frequencies(record, own.shape[1])))
    fine = np.arange(wave.shape[1]) / record.every
    return wave + np.array([np.interp(fine, np.arange(own.shape[1]), c) for c in change])


def _filtered(record: OpenRecord, series: np.ndarray, error: ChannelError) -> np.ndarray:
    """Series (..., samples) behind the filter that an error's factor undoes."""
    return _with_factor(series, 1 / (1 + error.factor(_frequencies(record, series.shape[-1]))))


def _frequencies(record: OpenRecord, samples: int) -> np.ndarray:
    """Those of a series that is continued by its mirror image, Hz."""
    return np.fft.rfftfreq(2 * samples, 1 / record.windows.sample_rate)


def _with_factor(series: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Series (..., samples) times a factor (samples + 1,) on their spectrum; both ends are continuous."""
    n = series.shape[-1]
    whole = np.concatenate([series, series[..., ::-1]], axis=-1)
    return np.asarray(scipy.fft.irfft(np.asarray(scipy.fft.rfft(whole, axis=-1)) * factor, 2 * n, axis=-1))[..., :n]


def open_noise(
    record: OpenRecord, loop: Loop, outputs: Sequence[str], predicted: np.ndarray | None, near: Experiment
) -> np.ndarray:
    """Standard deviation (outputs, axes, n) of the coordinates' noise, E|n|^2 = sd^2.

    Args:
        predicted: series (3, axes, samples) of the simulation nearest to the record, as `simulated_series` gives them;
            None or nan where none stands: then the recorded series themselves are taken, and the noise comes out too
            large where the loop resonates.
        near: the record's experiment on the rig of that simulation.
    """
    series = measured_series(record)
    series[2] -= record.added
    if predicted is not None and np.isfinite(predicted).all():
        series = measured_series(record) - predicted
    residual = loop.opened(record, series[0], series[2], series[1] if "amplifier" in outputs else None)
    for tone in record.tones:
        columns = tone_lines(record.windows, tone.frequency)
        a = tone.amplitude["opened"]
        residual[outputs.index("plant")] -= np.einsum("ca,cwl->awl", np.array([a.real, -a.imag]), columns)
        if "amplifier" in outputs:  # of what the command has of it, by an amplifier that is not the nominal one
            current = outputs.index("amplifier")
            residual[current] = without_tone(residual[current], columns)
    w, at = record.windows, outputs.index("plant")
    directions, rank = ringing_directions(record, near, driven_directions(record)[0])
    residual[at] = w.lines(without(w.project(residual[at]), directions))
    removed = np.zeros((len(outputs), 1, w.count))
    removed[at] = rank
    found = w.noise(residual, record.drives, _noise_shapes(loop, outputs), removed)
    # What a drive explains by chance is left out of that noise, and the force's own noise is part of the drive.
    return np.repeat(np.sqrt(np.maximum(found.variance, noise_of_force(record, loop, outputs))), KEPT, axis=-1)


def noise_of_force(record: OpenRecord, loop: Loop, outputs: Sequence[str]) -> np.ndarray:
    """Variance (outputs, axes, windows), E|n|^2, that the stated noise of a measured force adds to the coordinates.

    The simulation is driven by the force as it was read, noise included. A recording that no force drives has none.
    """
    shape = _noise_shapes(loop, outputs)[FORCE]
    stated = record.nominal.noise.force if np.any(record.waves["force"]) else 0.0
    return (2 * stated) ** 2 / record.windows.samples * shape


def _noise_shapes(loop: Loop, outputs: Sequence[str]) -> np.ndarray:
    """What the noise may be composed of, (shapes, outputs, axes, windows): white, of the current and of the FORCE."""
    plant, amplifier, receptance = (
        np.mean(abs(v.reshape(-1, *loop.shape)) ** 2, axis=-1)
        for v in (loop.blocks.plant, loop.blocks.amplifier, loop.blocks.receptance)
    )
    white, nothing = np.ones_like(plant), np.zeros_like(plant)
    of = {"plant": (white, plant, receptance), "amplifier": (white, amplifier, nothing)}
    return np.stack([np.stack(of[name]) for name in outputs], axis=1)
