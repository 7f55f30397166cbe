"""An experiment: a rig with its effects and gains, what excites it, for how long, and the seed of its noise."""

from dataclasses import dataclass, field

import numpy as np

from maglev_env.effects import NO_EFFECTS, Effects, check_effects
from maglev_env.excitation import Excitation, check_interleaved
from maglev_env.gains import Gains
from maglev_env.rig import Rig


@dataclass(frozen=True)
class Experiment:
    """Everything that determines a simulated record.

    excitations: periodic, on lines of one common fundamental. periods: how many are kept, after
    transient_periods that are dropped. offset: static reference, m. seed: of every noise channel.
    Raises ValueError when the parts do not fit together.
    """

    rig: Rig
    gains: Gains
    excitations: tuple[Excitation, ...]
    periods: int = 5
    transient_periods: int = 1
    effects: Effects = field(default_factory=lambda: NO_EFFECTS)
    offset: float = 0.0
    seed: int | tuple[int, ...] = 0

    def __post_init__(self) -> None:
        check_effects(self.effects)
        check_interleaved(self.excitations)
        if not any(e.periodic for e in self.excitations):
            raise ValueError("experiment: give at least one periodic excitation (sphs or multisine)")
        if not self.rig.controlled and any(e.at != "force" for e in self.excitations):
            raise ValueError(f"experiment: rig {self.rig.name} has no magnets: only a force can excite it")
        if self.periods < 1 or self.transient_periods < 0:
            raise ValueError("experiment: periods must be at least 1 and transient_periods at least 0")
        if self.offset and abs(self.offset) >= self.rig.clearance:
            raise ValueError(f"experiment: offset {self.offset} m is beyond the clearance {self.rig.clearance} m")

    @property
    def fundamental(self) -> float:
        return next(e.fundamental for e in self.excitations if e.periodic)

    @property
    def samples_per_period(self) -> int:
        return next(e for e in self.excitations if e.periodic).samples_per_period(self.rig.control_rate)

    def waveform(self, place: str) -> np.ndarray:
        """One period of what drives "force" (N), "current" (A) or "reference" (m, without the offset); or zeros."""
        waves = [e.waveform(self.rig.control_rate) for e in self.excitations if e.periodic and e.at == place]
        return sum(waves, np.zeros(self.samples_per_period))


def protocol_experiment(
    rig: Rig, gains: Gains | None = None, effects: Effects = NO_EFFECTS, seed: int | tuple[int, ...] = 0
) -> Experiment:
    """The rig's own SPHS protocol at the given gains (default: the rig's preset gains)."""
    p = rig.protocol
    return Experiment(rig, gains or rig.gains, p.excitations, p.periods, p.transient_periods, effects, seed=seed)
