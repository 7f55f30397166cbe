"""What a change of the rig makes of the noise in a measured drive, where only what an instrument causes is compared.

Noise that an unknown controller fed back moves the rotor, and the simulation that its current drives. What is left of
the reading along an instrument holds a part of the same noise. A change of the rig answers to it, too, and so seems to
explain it. Of a gain that is nothing beside its answer to the motion; of what is bounded, as a backlash of a tenth of
the noise, the answer to noise is the larger one. The directions of a window that are free of the instrument hold noise
alone: there that answer is told, and it is taken off along the instrument.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from estimation.lines.line_windows import KEPT, POOLED

LARGEST = 3.0  # standard deviations: what is left beyond is no noise


@dataclass(frozen=True)
class NoiseResponse:
    """A point of comparison, with what it leaves of the record.

    Args:
        at: coordinates (outputs, axes, n) of the simulation there.
        left: measured less these, (outputs, axes, n).
        noise: standard deviation of the noise, (outputs, axes, n).
        along: whether a coordinate is compared, (n,).
    """

    at: np.ndarray
    left: np.ndarray
    noise: np.ndarray
    along: np.ndarray

    def without(self, coordinates: np.ndarray) -> np.ndarray:
        """Coordinates (outputs, axes, n) of a simulation, without what its difference to the point makes of noise."""
        change = self.windowed(coordinates - self.at)
        free, left = ~self.windowed(self.along), self.windowed(self.left)
        together = uniform_filter1d(np.sum(change * np.conj(left) * free, axis=-1), POOLED, axis=-1)
        power = uniform_filter1d(np.sum(abs(left) ** 2 * free, axis=-1), POOLED, axis=-1)
        size = np.minimum(1.0, LARGEST * self.noise / np.maximum(abs(self.left), 1e-300))
        answer = (together / np.maximum(power, 1e-300))[..., None] * self.windowed(self.left * size)
        return coordinates - np.where(self.along, answer.reshape(coordinates.shape), 0.0)

    def without_in(self, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The same of changes (outputs, axes, n) by name.

        The scale of a current is that of the actuator's gain, and must answer to noise as the gain does: else noise
        would tell one from the other.
        """
        return {name: self.without(self.at + change) - self.at for name, change in columns.items()}

    @staticmethod
    def windowed(coordinates: np.ndarray) -> np.ndarray:
        """Coordinates (..., n) as (..., windows, KEPT)."""
        return coordinates.reshape(*coordinates.shape[:-1], -1, KEPT)
