"""The common structure of the lanes in a block."""

from dataclasses import dataclass, replace

import numpy as np

from maglev_env.channels import step_channels
from selfsense.kernel_pieces import SensorStructure


@dataclass(frozen=True)
class Structure:
    """The common structure of a block's lanes.

    Absent effects are compiled out. Whether there is noise is read at run time; converters are constants of the lanes.

    Args:
        magnets: the kind of magnet as it is simulated (see `kinds.simulated_as`), or "none".
        supported: whether there is a spring or a damper.
        sensor_poles, actuator_poles: 0, 1 or 2.
        delayed: whether a delay lies between controller and amplifier.
        noise: whether the reading has noise.
        controller_order: of a linear controller; 0: the PID.
        of_error: whether a linear controller is a filter of the error alone, without a limit.
        axes: 1 or 2.
        coupled: whether anything couples the axes.
        sensed: the self-sensors in the probes' place.
        saturating: whether fields of a pair saturate.
        steeper: whether the pull has an unusual falloff with the gap (see `kinds.steeper`).
        flexible: whether the kernel has all other effects at once, including two poles in each chain and a delay. A
            lane without one of them has neutral constants.
        sticking: whether their friction sticks.
        further: whether the flexible kernel also has the effects of `loop.further`, all at once.
        free: whether the flexible kernel also has the free corrections of `loop.free`, all at once.
        shaped: whether effects have other forms than the plain ones (see `loop.effect.shaped`).
        own_waves: whether every lane chooses one of several waves; otherwise all are driven by the same.
    """

    magnets: str
    supported: bool
    sensor_poles: int
    actuator_poles: int
    delayed: bool
    noise: bool
    controller_order: int = 0
    of_error: bool = True
    axes: int = 1
    coupled: bool = False
    sensed: SensorStructure | None = None
    saturating: bool = False
    steeper: bool = False
    flexible: bool = False
    sticking: bool = False
    further: bool = False
    free: bool = False
    shaped: bool = False
    own_waves: bool = False

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that the kernel can write, in order."""
        return step_channels(sensed=bool(self.sensed))

    @property
    def compiled(self) -> "Structure":
        """The structure without the parts that are read at run time; structures with the same one share a kernel."""
        return replace(self, noise=False)

    @property
    def joint(self) -> "Structure":
        """The structure with both poles in each chain, a delay and a support: lanes with and without them share blocks.

        Neutral constants change no result. The flexible kernel has these parts anyway, but takes three times as long.
        """
        if self.flexible:
            return self
        probe, current = 0 if self.sensed else 2, 2 if self.actuator_poles else 0
        return replace(self, supported=True, delayed=True, sensor_poles=probe, actuator_poles=current)

    def switches(self, substeps: int = 1, oversampled: bool = False, waves: int = 1) -> np.ndarray:
        """Switches that the kernel reads at run time (see `advance.kernel`)."""
        return np.array([self.noise, substeps, oversampled, waves], dtype=np.int64)
