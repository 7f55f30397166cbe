"""What an open record says and what a hypothesis predicts of it, as coordinates of the opened loop with their noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimation.line_windows import WIDTH
from maglev_env.kernel.replay import replayed
from maglev_env.loop.gains import of_axis
from sim2real.drive import recovered_injection
from sim2real.open_loop import Loop
from sim2real.open_record import KEPT, OpenRecord
from sim2real.opened import Opened


def opened_of(record: OpenRecord, loop: Loop) -> Opened:
    """The nominal blocks at the middle of each coordinate's window, in the form that periodic records have."""
    outputs = ("plant", "amplifier") if "current" in record.series and record.experiment.rig.controlled else ("plant",)
    blocks = (np.repeat(v[..., WIDTH // 2], KEPT, axis=-1) for v in vars(loop).values())
    return Opened(*blocks, outputs)


def simulated_series(record: OpenRecord, lanes: list) -> np.ndarray:
    """Displacements and currents (n, 2, axes, samples) of prepared lanes at the recorded samples; nan where they touch
    down."""
    return replayed(lanes, record.experiment, record.waves)[..., :: record.every]


@dataclass(frozen=True)
class Replay:
    """Predicts the coordinates of an open record: its closed loop, simulated under what drove it."""

    record: OpenRecord
    loop: Loop
    outputs: tuple[str, ...]

    def of(self, lanes: list) -> np.ndarray:
        """(n, outputs, axes, coordinates) of prepared lanes; nan where the rotor touches down."""
        series = simulated_series(self.record, lanes)
        # One lane's spectra are in memory at a time.
        return np.array([coordinates_of(self.record, self.loop, self.outputs, one) for one in series])


def coordinates_of(record: OpenRecord, loop: Loop, outputs: Sequence[str], series: np.ndarray) -> np.ndarray:
    """Opened coordinates (outputs, axes, n) of displacements and currents (2, axes, samples)."""
    opened = loop.opened(record, series[0], series[1] if "amplifier" in outputs else None)
    return record.windows.project(opened).reshape(*opened.shape[:2], -1)


def measured_of(record: OpenRecord, loop: Loop, outputs: Sequence[str]) -> np.ndarray:
    """Opened coordinates (outputs, axes, n) of what was recorded."""
    series = record.series
    return coordinates_of(
        record, loop, outputs, np.stack([series["displacement"], series.get("current", series["displacement"])])
    )


def parts_of(record: OpenRecord, loop: Loop, predicted: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """What each channel adds to the opened residuals, see `channel_errors.changes`, (axes, windows, WIDTH).

    All of it comes from the simulation, which is free of the sensor's noise.

    Args:
        predicted: displacement and current (2, axes, samples) of the simulation nearest to the record.
    """
    e, dt, every = record.experiment, 1 / record.experiment.rig.control_rate, record.every
    y, i = (record.spectrum(series) for series in predicted)
    found = {"displacement": {"plant": y}, "current": {"amplifier": i}}
    force = record.waves["force"]
    found["force"] = {"plant": -loop.receptance * record.spectrum(force[:, ::every])}
    at_ticks = np.repeat(predicted[0], every, axis=1)
    fed = [recovered_injection(of_axis(e.gains, a), w, x, dt) for a, (w, x) in
           enumerate(zip(-record.waves["current"], at_ticks, strict=True))]  # fmt: skip
    command = record.spectrum(-np.array(fed)[:, ::every])
    if record.source == "command":
        found["command"] = {"plant": -loop.plant * command, "amplifier": -loop.amplifier * command}
    elif record.source == "current":
        found["current"] = {"plant": -loop.plant * command}
    else:
        for channel, place in (("injection", "current"), ("reference", "reference")):
            wave = record.spectrum(record.waves[place][:, ::every])
            own = wave if place == "current" else loop.controller * wave
            found[channel] = {"plant": -loop.plant * own, "amplifier": -loop.amplifier * own}
    return found


def open_noise(record: OpenRecord, loop: Loop, outputs: Sequence[str], predicted: np.ndarray | None) -> np.ndarray:
    """Standard deviation (outputs, axes, n) of the coordinates' noise, E|n|^2 = sd^2.

    Args:
        predicted: series (2, axes, samples) of the simulation nearest to the record, as `replayed` gives them; None or
            nan where none stands: then the recorded series themselves are taken, and the noise comes out too large
            where the loop resonates.
    """
    measured = np.stack([record.series[name] for name in ("displacement", "current") if name in record.series])
    if predicted is not None and np.isfinite(predicted).all():
        measured = measured - predicted[: len(measured)]
    residual = loop.opened(record, measured[0], measured[1] if "amplifier" in outputs else None)
    found = record.windows.noise(residual, record.drives)
    return np.repeat(np.sqrt(found.variance), KEPT, axis=-1)
