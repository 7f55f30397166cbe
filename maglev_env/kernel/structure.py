"""What lanes that run together in a block have in common."""

from dataclasses import dataclass, replace

import numpy as np

from maglev_env.channels import step_channels
from selfsense.kernel_pieces import SensorStructure


@dataclass(frozen=True)
class Structure:
    """What a block's lanes share. Absent effects are compiled out; noise is read at run time, converters
    are data.

    Args:
        magnets: the kind of magnet as it is simulated (see `kinds.simulated_as`), or "none".
        supported: whether there is a spring or a damper.
        sensor_poles, actuator_poles: 0, 1 or 2.
        delayed: whether a delay lies between controller and amplifier.
        noise: whether the reading has noise.
        controller_order: of a linear controller; 0: the PID.
        axes: 1 or 2.
        coupled: whether anything couples the axes.
        sensed: the self-sensors in the probes' place.
        saturating: whether fields of a pair saturate.
        flexible: whether all other effects are there at once, two poles in each chain and a delay among them. A lane
            without one carries neutral constants.
        sticking: whether their friction sticks.
    """

    magnets: str
    supported: bool
    sensor_poles: int
    actuator_poles: int
    delayed: bool
    noise: bool
    controller_order: int = 0
    axes: int = 1
    coupled: bool = False
    sensed: SensorStructure | None = None
    saturating: bool = False
    flexible: bool = False
    sticking: bool = False

    @property
    def channels(self) -> tuple[str, ...]:
        """What the kernel can write, in this order."""
        return step_channels(sensed=bool(self.sensed))

    @property
    def compiled(self) -> "Structure":
        """The structure that shares this one's kernel: without what is read at run time."""
        return replace(self, noise=False)

    def switches(self, outputs: int, substeps: int = 1, oversampled: bool = False) -> np.ndarray:
        """What the kernel reads at run time: the rest of the structure, and how it runs (see `advance.kernel`)."""
        return np.array([self.noise, outputs, substeps, oversampled], dtype=np.int64)
