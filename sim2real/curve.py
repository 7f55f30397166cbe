"""A closed-loop response, measured and simulated, as the figures of a diagnosis draw it."""

from dataclasses import dataclass

import numpy as np

FEWEST = 3  # frequencies that a curve needs


@dataclass(frozen=True)
class Curve:
    """A closed-loop response of a judged recording, measured and simulated.

    Attributes:
        kind: "receptance" (m/N, displacement over force) or "sensitivity" (command over injection).
        record: Name of the recording.
        axis: "x" or "y"; "" for a one-axis rig.
        frequency: Frequencies (n,), Hz.
        measured: Measured response (n,).
        sd: Standard deviation (n,) of the complex value, E|n|^2 = sd^2.
        nominal: Response of the nominal rig (n,); nan where the rotor touches down.
        corrected: Response of the corrected rig (n,); nan where the rotor touches down.
    """

    kind: str
    record: str
    axis: str
    frequency: np.ndarray
    measured: np.ndarray
    sd: np.ndarray
    nominal: np.ndarray
    corrected: np.ndarray

    def distance(self, simulated: np.ndarray) -> np.ndarray:
        """Distance of a simulated curve in units of the noise; its rms is 1 where the curves differ by noise alone."""
        return abs(simulated - self.measured) / self.sd
