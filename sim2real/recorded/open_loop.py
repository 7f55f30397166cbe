"""The linear nominal loop of a recording without a period, and the opening of spectra at it."""

from dataclasses import dataclass

import numpy as np

from sim2real.recorded.nominal import nominal_blocks, outputs_of
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import Opened


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
