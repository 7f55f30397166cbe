"""What an open record says and what a hypothesis predicts of it, as coordinates of the opened loop with their noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimation.line_windows import WIDTH
from maglev_env.experiment import axis_experiment
from maglev_env.kernel.replay import replayed
from maglev_env.linear.loop import loop_response
from sim2real.open_record import KEPT, OpenRecord
from sim2real.opened import Opened


@dataclass(frozen=True)
class Loop:
    """The nominal loop at every line of a record's windows, (axes, windows, WIDTH) each."""

    controller: np.ndarray
    amplifier: np.ndarray
    plant: np.ndarray
    receptance: np.ndarray

    def opened(self, record: OpenRecord, displacement: np.ndarray, current: np.ndarray | None) -> np.ndarray:
        """Opened spectra (..., outputs, axes, windows, WIDTH) of series (..., axes, samples)."""
        y = record.spectrum(displacement)
        found = [y + self.plant * self.controller * y]
        if current is not None:
            found.append(record.spectrum(current) + self.amplifier * self.controller * y)
        return np.stack(found, axis=-4)


def nominal_loop(record: OpenRecord) -> Loop:
    """The linear nominal loop under a record's gains."""
    found = []
    for axis in range(record.axes):
        r = loop_response(axis_experiment(record.experiment, axis), record.windows.frequency.ravel())
        found.append((r.controller, r.amplifier, r.plant, r.receptance / r.sensitivity))
    shape = record.windows.frequency.shape
    return Loop(*(np.array(v).reshape(record.axes, *shape) for v in zip(*found, strict=True)))


def opened_of(record: OpenRecord, loop: Loop) -> Opened:
    """The nominal blocks at the middle of each coordinate's window, in the form that periodic records have."""
    outputs = ("plant", "amplifier") if "current" in record.series and record.experiment.rig.controlled else ("plant",)
    blocks = (np.repeat(v[..., WIDTH // 2], KEPT, axis=-1) for v in vars(loop).values())
    return Opened(*blocks, outputs)


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
            opened = self.loop.opened(r, one[0], one[1] if "amplifier" in self.outputs else None)
            found.append(r.windows.project(opened).reshape(*opened.shape[:2], -1))
        return np.array(found)


def measured_of(record: OpenRecord, loop: Loop, outputs: Sequence[str]) -> np.ndarray:
    """Opened coordinates (outputs, axes, n) of what was recorded."""
    current = record.series["current"] if "amplifier" in outputs else None
    opened = loop.opened(record, record.series["displacement"], current)
    return record.windows.project(opened).reshape(*opened.shape[:2], -1)


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
    driven = np.concatenate([record.spectrum(w) for w in record.waves.values()])
    driven = driven[np.ptp(np.concatenate(list(record.waves.values())), axis=1) > 0]
    found = record.windows.noise(residual, driven if len(driven) else np.zeros((1, *record.windows.frequency.shape)))
    return np.repeat(np.sqrt(found.variance), KEPT, axis=-1)
