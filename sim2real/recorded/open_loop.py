"""The linear nominal loop of a recording without a period, and the opening of spectra at it."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.fft

from maglev_env.experiment import Experiment
from sim2real.recorded.along_motion import AlongMotion
from sim2real.recorded.nominal import nominal_blocks, outputs_of
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import Opened

ROUNDS = 2  # in which the motion by a force follows from the force, and the force from the motion


@dataclass(frozen=True)
class Bent:
    """A linear plant at every line of a record, with what its magnets have more along the motion.

    Args:
        along: what they have more.
        plant: (axes, samples // 2 + 1), m/A.
        receptance: of the opened loop, for a force that is held over a control step, in the same shape, m/N.
    """

    along: AlongMotion
    plant: np.ndarray
    receptance: np.ndarray

    def motion(self, command: np.ndarray, transform: np.ndarray) -> np.ndarray:
        """Transform of the reading beyond that of this linear plant under a command (..., axes, samples), m.

        Args:
            command: the command, A.
            transform: of the command, (..., axes, samples // 2 + 1), as `scipy.fft.rfft` makes it.
        """
        n, along = command.shape[-1], self.along
        # The mean tells where the mass hangs, which is not compared here; its effect on the force law is left out, too.
        by_current = along.driven(command - command.mean(axis=-1, keepdims=True))
        linear = self.plant * transform
        linear[..., 0] = 0.0
        more = np.zeros_like(linear)
        for _ in range(ROUNDS):
            x = np.asarray(scipy.fft.irfft(linear + more, n, axis=-1))
            middle = (x + np.concatenate([x[..., 1:], x[..., -1:]], axis=-1)) / 2
            lacks = by_current - along.stiffness * middle
            more = self.receptance * np.asarray(scipy.fft.rfft(lacks, axis=-1))
        return more


@dataclass(frozen=True)
class Loop:
    """The nominal loop at every line of a record's windows.

    Args:
        blocks: responses (axes, windows * WIDTH), see `Opened`.
        shape: windows, WIDTH.
        bent: the magnets along the motion; None: as at rest.
    """

    blocks: Opened
    shape: tuple[int, int]
    bent: Bent | None = None

    def opened(
        self, record: OpenRecord, displacement: np.ndarray, command: np.ndarray, current: np.ndarray | None
    ) -> np.ndarray:
        """Opened spectra (..., outputs, axes, windows, WIDTH) of series (..., axes, samples); command: by the readings.

        They are those of `Opened.residuals`, but with the controller's part of the command in time: what an integral
        remembers at the ends of a record would leak into the lowest windows.
        """
        plant, amplifier = (v.reshape(-1, *self.shape) for v in (self.blocks.plant, self.blocks.amplifier))
        own = command[..., record.first : record.first + record.windows.samples]
        transform = np.asarray(scipy.fft.rfft(own, axis=-1))
        u = record.windows.of_transform(transform)
        found = [record.spectrum(displacement) - plant * u]
        if self.bent is not None:
            found[0] -= record.windows.of_transform(self.bent.motion(own, transform))
        if current is not None:
            found.append(record.spectrum(current) - amplifier * u)
        return np.stack(found, axis=-4)


def loop_at(record: OpenRecord, near: Experiment, predicted: np.ndarray | None = None) -> Loop:
    """The linear loop at which a record is opened: the nominal one, or that of a rig which was found.

    Which linear loop opens the spectra does not matter, as what it leaves of the noise is stationary. Where gain and
    stiffness change along the motion it matters, because the answer of the loop to its noise changes along with them.

    Args:
        record: the record.
        near: the rig that was found, under the record's gains.
        predicted: its simulated displacement, current and command (3, axes, samples); None or nan: it is not known.
    """
    if record.along is None:
        return nominal_loop(record)
    motion = record.along.motion
    if predicted is not None and np.isfinite(predicted).all():
        looked = slice(record.first, record.first + record.windows.samples)
        motion = motion.halfway(
            (record.command - predicted[2])[:, looked], (record.series["displacement"] - predicted[0])[:, looked]
        )
    return nominal_loop(replace(record, experiment=near, along=record.along.under(near, motion)))


def nominal_loop(record: OpenRecord) -> Loop:
    """The linear nominal loop under a record's gains."""
    frequency, outputs = record.windows.frequency, outputs_of("current" in record.series, record.experiment)
    blocks = nominal_blocks(record.experiment, frequency.ravel(), "amplifier" in outputs)
    return Loop(Opened(*blocks, outputs), frequency.shape, _bent(record))


def _bent(record: OpenRecord) -> Bent | None:
    if record.along is None:
        return None
    w = record.windows
    frequency = np.fft.rfftfreq(w.samples, 1 / w.sample_rate)
    frequency[0] = frequency[1] / 1000  # an integral has no response to what never changes
    blocks = Opened(*nominal_blocks(record.experiment, frequency, False), ("plant",))
    held = np.mean(np.exp(-2j * np.pi * np.outer(frequency / w.sample_rate, np.arange(record.every) / record.every)), 1)
    return Bent(record.along, blocks.plant, blocks.receptance * held)
