"""The linear nominal loop of a recording without a period, and the opening of spectra at it."""

from dataclasses import dataclass

import numpy as np

from maglev_env.experiment import axis_experiment
from maglev_env.linear.loop import loop_response
from sim2real.open_record import OpenRecord


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
