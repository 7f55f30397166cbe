"""What an open record says and what a hypothesis predicts of it, as coordinates of the opened loop with their noise."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from estimation.line_windows import WIDTH
from maglev_env.kernel.replay import replayed
from sim2real.open_record import KEPT, OpenRecord
from sim2real.opened import Opened, nominal_blocks, outputs_of


@dataclass(frozen=True)
class Loop:
    """The nominal loop at every line of a record's windows.

    Args:
        blocks: responses (axes, windows * WIDTH), see `Opened`.
        shape: windows, WIDTH.
    """

    blocks: Opened
    shape: tuple[int, int]

    def opened(
        self, record: OpenRecord, displacement: np.ndarray, command: np.ndarray, current: np.ndarray | None
    ) -> np.ndarray:
        """Opened spectra (..., outputs, axes, windows, WIDTH) of series (..., axes, samples); command: by the readings.

        They are those of `Opened.residuals`, but with the controller's part of the command in time: what an integral
        remembers at the ends of a record would leak into the lowest windows.
        """
        plant, amplifier = (v.reshape(-1, *self.shape) for v in (self.blocks.plant, self.blocks.amplifier))
        u = record.spectrum(command)
        found = [record.spectrum(displacement) - plant * u]
        if current is not None:
            found.append(record.spectrum(current) - amplifier * u)
        return np.stack(found, axis=-4)


def nominal_loop(record: OpenRecord) -> Loop:
    """The linear nominal loop under a record's gains."""
    frequency, outputs = record.windows.frequency, outputs_of("current" in record.series, record.experiment)
    blocks = nominal_blocks(record.experiment, frequency.ravel(), "amplifier" in outputs)
    return Loop(Opened(*blocks, outputs), frequency.shape)


def opened_of(loop: Loop) -> Opened:
    """The nominal blocks at the middle of each coordinate's window, in the form that periodic records have."""
    blocks = [np.reshape(getattr(loop.blocks, f.name), (-1, *loop.shape)) for f in fields(Opened)[:-1]]
    return Opened(*(np.repeat(v[..., WIDTH // 2], KEPT, axis=-1) for v in blocks), loop.blocks.outputs)


@dataclass(frozen=True)
class Replay:
    """Predicts the coordinates of an open record: its closed loop, simulated under what drove it."""

    record: OpenRecord
    loop: Loop
    outputs: tuple[str, ...]

    def of(self, lanes: list) -> np.ndarray:
        """(n, outputs, axes, coordinates) of prepared lanes; nan where the rotor touches down."""
        r = self.record
        series = replayed(lanes, r.experiment, r.waves)
        found = []
        for one in series:  # one lane's spectra in memory at a time
            opened = self.loop.opened(r, one[0], one[2] - r.added, one[1] if "amplifier" in self.outputs else None)
            found.append(r.windows.project(opened).reshape(*opened.shape[:2], -1))
        return np.array(found)


def measured_of(record: OpenRecord, loop: Loop, outputs: Sequence[str]) -> np.ndarray:
    """Opened coordinates (outputs, axes, n) of what was recorded."""
    current = record.series["current"] if "amplifier" in outputs else None
    opened = loop.opened(record, record.series["displacement"], record.command - record.added, current)
    return record.windows.project(opened).reshape(*opened.shape[:2], -1)


def open_noise(record: OpenRecord, loop: Loop, outputs: Sequence[str], predicted: np.ndarray | None) -> np.ndarray:
    """Standard deviation (outputs, axes, n) of the coordinates' noise, E|n|^2 = sd^2.

    Args:
        predicted: series (3, axes, samples) of the simulation nearest to the record, as `replayed` gives them; None or
            nan where none stands: then the recorded series themselves are taken, and the noise comes out too large
            where the loop resonates.
    """
    current = record.series["current"] if "amplifier" in outputs else None
    measured, command = record.series["displacement"], record.command - record.added
    if predicted is not None and np.isfinite(predicted).all():
        measured, command = measured - predicted[0], record.command - predicted[2]
        current = None if current is None else current - predicted[1]
    residual = loop.opened(record, measured, command, current)
    driven = np.concatenate([record.spectrum(w) for w in record.waves.values()])
    driven = driven[np.ptp(np.concatenate(list(record.waves.values())), axis=1) > 0]
    found = record.windows.noise(residual, driven if len(driven) else np.zeros((1, *record.windows.frequency.shape)))
    return np.repeat(np.sqrt(found.variance), KEPT, axis=-1)
