"""The noise of a bench, as its recordings with a period show it, which bounds that of its other recordings.

A recording without a period does not repeat, so that its noise is told from what a simulation leaves of it. What a
nonlinearity adds there goes with no smooth response to the drive and passes for noise, however large. Periods that
repeat tell the noise from their scatter alone. Opened at the nominal loop, noise is that of the sensor and of forces on
the rotor (see `recorded.opened`): it belongs to the bench, and not to what drives the loop. Only the noise in the
reading of a force belongs to the recordings which that force drives.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from estimation.lines.line_windows import KEPT, WIDTH
from sim2real.recorded.open_evidence import noise_of_force
from sim2real.recorded.open_loop import nominal_loop
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import noise_of, opened_loop
from sim2real.recorded.records import Record

NEIGHBOURS = 15  # lines whose median is taken: a line with a tone shows more than the noise
LOUDER = 1.5  # times the bench's noise that a recording may have: noise depends a little on place and motion
REACHED = 0.05  # share of a recording's coordinates that must be at the bound for its noise to count as bounded
RINGS = 0.3  # share of a resonance's peak above which a line counts as part of the resonance


@dataclass(frozen=True)
class BenchNoise:
    """Noise density by output, one pair of arrays for each recording with a period.

    Attributes:
        shown: Output -> (frequency (n,) in Hz, density (n,) in squares of the output's unit per Hz).
    """

    shown: Mapping[str, tuple[tuple[np.ndarray, np.ndarray], ...]]

    def most(self, record: OpenRecord, outputs: Sequence[str]) -> np.ndarray:
        """Largest standard deviation (outputs, 1, n) of the noise of a recording's coordinates; inf where nothing is
        known of it: where no recording with a period has lines, and at a resonance of the nominal plant. How that rings
        at the begin of the recording differs from line to line, and is noise of this recording alone."""
        w, found = record.windows, np.full((len(outputs), 1, record.frequency.size), np.inf)
        if not self.shown:
            return found
        ringing = np.repeat(_resonant(record), KEPT)
        of_force = np.repeat(noise_of_force(record, nominal_loop(record), outputs).max(axis=1), KEPT, axis=-1)
        for row, output, driven in zip(found, outputs, of_force, strict=True):
            each = [
                np.interp(record.frequency, f, density, np.nan, np.nan) for f, density in self.shown.get(output, ())
            ]
            if each:
                densest = np.fmax.reduce(each)
                sd = np.sqrt(LOUDER**2 * densest * w.sample_rate / w.samples + driven)
                row[0] = np.where(np.isfinite(sd) & ~ringing, sd, np.inf)
        return found

    def reached(self, record: Record | OpenRecord, outputs: Sequence[str], noise: np.ndarray) -> bool:
        """Whether a recording without a period leaves more than the bench's noise: its noise (outputs, axes, n), as it
        was taken, is the largest possible in a share REACHED of its coordinates."""
        if not isinstance(record, OpenRecord):
            return False
        return float(np.mean(noise >= (1 - 1e-9) * self.most(record, outputs))) > REACHED


def _resonant(record: OpenRecord) -> np.ndarray:
    """Windows (n,) in which the nominal plant resonates: in which its response is above RINGS of a peak."""
    loop = nominal_loop(record)
    size = abs(loop.blocks.plant.reshape(-1, *loop.shape)).max(axis=0).ravel()
    peaks = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])) + 1
    above = np.zeros(size.size, bool)
    for peak in peaks:
        low = np.flatnonzero(size < RINGS * size[peak])
        begin, end = low[low < peak].max(initial=-1), low[low > peak].min(initial=size.size)
        above[begin + 1 : end] = True
    return above.reshape(-1, WIDTH).any(axis=1)


NO_BOUND = BenchNoise({})


def bench_noise(records: Sequence[Record | OpenRecord]) -> BenchNoise:
    """The noise that the recordings with a period show; the largest counts."""
    shown: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for record in records:
        if isinstance(record, OpenRecord):
            continue
        opened = opened_loop(record)
        seconds = record.count / record.experiment.fundamental
        variance = noise_of(record, opened).max(axis=1) ** 2  # (outputs, n), of the mean of all periods
        for output, own in zip(opened.outputs, variance, strict=True):
            smooth = median_filter(own, min(NEIGHBOURS, own.size), mode="nearest")
            shown.setdefault(output, []).append((record.frequency, smooth * seconds))
    return BenchNoise({output: tuple(each) for output, each in shown.items()})
