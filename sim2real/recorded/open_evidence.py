"""What an open record says and what a hypothesis predicts of it, as coordinates of the opened loop with their noise."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from estimation.line_windows import WIDTH
from maglev_env.kernel.driven import Drive
from maglev_env.kernel.replay import look_at_replays, replayed
from maglev_env.kernel.simulate import Block
from sim2real.recorded.open_loop import Loop
from sim2real.recorded.open_record import KEPT, OpenRecord
from sim2real.recorded.opened import Opened


def opened_of(loop: Loop) -> Opened:
    """The nominal blocks at the middle of each coordinate's window, in the form that periodic records have."""
    blocks = [np.reshape(getattr(loop.blocks, f.name), (-1, *loop.shape)) for f in fields(Opened)[:-1]]
    return Opened(*(np.repeat(v[..., WIDTH // 2], KEPT, axis=-1) for v in blocks), loop.blocks.outputs)


def simulated_series(record: OpenRecord, lanes: list[Block]) -> np.ndarray:
    """Displacement, current and command (n, 3, axes, samples) of prepared lanes at the recorded samples; nan where they
    touch down."""
    (found,) = replayed(lanes, [Drive(record.experiment, record.waves)])
    return found[..., :: record.every]


@dataclass(frozen=True)
class Replay:
    """Predicts the coordinates of an open record: its closed loop, simulated under what drove it."""

    record: OpenRecord
    loop: Loop
    outputs: tuple[str, ...]


def coordinates_of_lanes(replays: Sequence[Replay], lanes: list[Block]) -> list[np.ndarray]:
    """(n, outputs, axes, coordinates) of prepared lanes, of each record; nan where the rotor touches down."""

    count = sum(len(block.members) for block in lanes)
    found = [np.empty((count, len(r.outputs), r.record.axes, r.record.frequency.size), complex) for r in replays]

    def look(which: int, lane: int, series: np.ndarray) -> None:
        own = replays[which]
        found[which][lane] = coordinates_of(own.record, own.loop, own.outputs, series[..., :: own.record.every])

    look_at_replays(lanes, [Drive(own.record.experiment, own.record.waves) for own in replays], look)
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
    plant, amplifier, receptance, referred = (
        np.reshape(v, (-1, *loop.shape))
        for v in (loop.blocks.plant, loop.blocks.amplifier, loop.blocks.receptance, loop.blocks.from_reference)
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
        found["current"] = {"plant": -plant * command}
    else:
        for channel, own in (("injection", injection), ("reference", referred * reference)):
            found[channel] = {"plant": -plant * own, "amplifier": -amplifier * own}
    return found


def open_noise(record: OpenRecord, loop: Loop, outputs: Sequence[str], predicted: np.ndarray | None) -> np.ndarray:
    """Standard deviation (outputs, axes, n) of the coordinates' noise, E|n|^2 = sd^2.

    Args:
        predicted: series (3, axes, samples) of the simulation nearest to the record, as `simulated_series` gives them;
            None or nan where none stands: then the recorded series themselves are taken, and the noise comes out too
            large where the loop resonates.
    """
    series = measured_series(record)
    series[2] -= record.added
    if predicted is not None and np.isfinite(predicted).all():
        series = measured_series(record) - predicted
    residual = loop.opened(record, series[0], series[2], series[1] if "amplifier" in outputs else None)
    found = record.windows.noise(residual, record.drives)
    return np.repeat(np.sqrt(found.variance), KEPT, axis=-1)
