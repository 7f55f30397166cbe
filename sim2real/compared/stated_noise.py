"""Is what is left of recordings that never repeat as loud as the noise that the rig states?

Where a recording repeats, it tells its noise. Elsewhere what the best explanation leaves is taken for noise, and the
only witness against that is the rig's statement: an uneven converter, or lost samples, scatter as noise does.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from estimation.lines.line_windows import KEPT
from sim2real.compared.bench_noise import BenchNoise
from sim2real.compared.problem import Part, Problem
from sim2real.recorded.open_evidence import noise_of_force
from sim2real.recorded.open_loop import nominal_loop
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.recorded.ringing import driven_directions, without

# Times the stated noise in the LOUDEST share of the band: from where on it is said, and from where on the statement
# would have to be so wrong that it counts as a gap.
OVER_STATED, BEYOND_STATED, LOUDEST = 2.0, 3.0, 0.2
Noisy = tuple[Record | OpenRecord, Sequence[str], np.ndarray]  # a recording, its outputs and noise (outputs, axes, n)


def left_alone(problem: Problem, residual: np.ndarray) -> list[Noisy]:
    """The recordings of a problem with the noise that each window without a period shows by itself.

    A fit takes noise that is pooled over neighbouring windows. A tone or a sharp mode that is left in one of them would
    make all of those look loud.

    Args:
        problem: what was fitted.
        residual: (K,), what the best fit leaves, whitened.
    """
    return [(p.record, p.opened.outputs, _alone(p, residual[p.place])) for p in problem.parts]


def _alone(part: Part, residual: np.ndarray) -> np.ndarray:
    """Standard deviation (outputs, axes, n) of what a recording leaves in each window, beside what drives explain."""
    record = part.record
    if not isinstance(record, OpenRecord) or record.instrument is not None:
        return part.noise
    left = np.zeros(part.noise.shape, complex)
    left[..., part.used] = residual.reshape(part.whitening.shape) / part.whitening
    directions, rank = driven_directions(record)
    rest = without(left.reshape(*left.shape[:2], -1, KEPT), directions)
    freedom = np.repeat(part.used.reshape(-1, KEPT).sum(axis=-1) - rank, KEPT)
    power = np.repeat(np.sum(abs(rest) ** 2, axis=-1), KEPT, axis=-1)
    return np.where(freedom > 0, np.sqrt(power / np.maximum(freedom, 1)), part.noise)


def louder_than_stated(parts: Iterable[Noisy], least: float = OVER_STATED) -> dict[str, float]:
    """Recording -> how many times as loud its noise is as the rig states, at least in the loudest share of the band.

    What an effect leaves is often loud at low frequencies alone, where the rotor moves.

    Args:
        parts: of a campaign that repeats nowhere.
        least: what counts.
    """
    return {name: most for name, _, most in _ratios(parts) if most > least}


def scattered(parts: Iterable[Noisy]) -> float:
    """Cost of what is left beyond the stated noise, of the recordings in which that is louder than BEYOND_STATED: what
    it would weigh if it were no noise, in units of what is left."""
    beyond = (2 * np.maximum(1 - ratio**-2.0, 0.0).sum() for _, ratio, most in _ratios(parts) if most > BEYOND_STATED)
    return float(sum(beyond))


def _ratios(parts: Iterable[Noisy]) -> Iterable[tuple[str, np.ndarray, float]]:
    """Of each recording without a period its name, how many times as loud it is as stated at each coordinate (axes, n),
    and at least in the loudest share of them; without those for which the rig states no noise of the displacement."""
    for record, outputs, noise in parts:
        if isinstance(record, OpenRecord) and record.nominal.noise.displacement:
            at = list(outputs).index("plant")
            ratio = noise[at] / np.sqrt(_stated(record, outputs)[at])
            yield record.name, ratio, float(np.quantile(ratio, 1 - LOUDEST))


def _stated(record: OpenRecord, outputs: Sequence[str]) -> np.ndarray:
    """Variance (outputs, axes, n) of the opened displacement by the noise that the rig states, converters included."""
    rig, loop = record.nominal, nominal_loop(record)
    plant = np.repeat(np.mean(abs(loop.blocks.plant.reshape(-1, *loop.shape)) ** 2, axis=-1), KEPT, axis=-1)
    reading = rig.noise.displacement**2 + rig.reading_step**2 / 12
    current = rig.noise.current**2 + rig.command_step**2 / 12
    of_force = np.repeat(noise_of_force(record, loop, outputs), KEPT, axis=-1)
    return 4 / record.windows.samples * (reading + plant * current) + of_force


class StatedNoise(BenchNoise):
    """The noise of the displacement that the rig states, in place of what recordings with a period show."""

    def most(self, record: OpenRecord, outputs: Sequence[str]) -> np.ndarray:
        """As of `BenchNoise`, (outputs, axes, n); inf where the rig states none."""
        sd = np.sqrt(_stated(record, outputs))
        known = np.array([output == "plant" and bool(record.nominal.noise.displacement) for output in outputs])
        return np.where(known[:, None, None], sd, np.inf)


STATED = StatedNoise({})


def louder_in_words(loud: Mapping[str, float]) -> list[str]:
    """A note on recordings that are louder than the rig states (see `louder_than_stated`); none where none is."""
    if not loud:
        return []
    return [
        f"{', '.join(loud)}: what is left is {max(loud.values()):.2g} times as loud as the noise that the rig states, "
        "and no recording repeats, which would tell noise from what an effect leaves: record periods of a multisine, "
        "or state the noise as it is"
    ]
