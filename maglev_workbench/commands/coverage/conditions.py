"""The conditions under which the intervals of `maglev estimate` are counted."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.loop.effect import NO_EFFECTS, Effects
from maglev_env.loop.gains import Gains
from maglev_env.rig.rig import Rig, load_rig


@dataclass(frozen=True)
class Condition:
    """One kind of experiment, drawn with other phases and other noise each time.

    Args:
        title: in words.
        rig: name of a preset.
        periods: that are kept.
        gains: factor of kp and kd.
        amplitude: factor of the protocol's amplitudes.
        effects: of the rig that is recorded.
        places: where the protocol's excitation is kept.
        hidden: channels that are not recorded.
    """

    title: str
    rig: str = "hmb_free"
    periods: int = 5
    gains: float = 1.0
    amplitude: float = 1.0
    effects: Effects = field(default_factory=lambda: NO_EFFECTS)
    places: tuple[str, ...] = ("force", "current")
    hidden: tuple[str, ...] = ()

    @property
    def nominal(self) -> Rig:
        """The rig that the estimate is told."""
        return load_rig(self.rig)

    def experiment(self, seed: int, draw: int) -> Experiment:
        """The experiment of one draw; the seed of a study decides all of them."""
        rig = self.nominal
        assert isinstance(rig.gains, Gains)
        first = protocol_experiment(rig, replace(rig.gains, kp=rig.gains.kp * self.gains, kd=rig.gains.kd * self.gains))
        excitations = tuple(
            replace(e, kind="multisine", seed=1000 * seed + draw, amplitude=e.amplitude * self.amplitude)
            for e in first.excitations
            if e.at in self.places
        )
        return replace(first, excitations=excitations, periods=self.periods, effects=self.effects, seed=(seed, draw))


CONDITIONS: Mapping[str, Condition] = {
    "linear": Condition("the preset's protocol"),
    "two_periods": Condition("two periods", periods=2),
    "nine_periods": Condition("nine periods", periods=9),
    "soft": Condition("kp and kd times 0.7: nearer to instability", gains=0.7),
    "faint": Condition("a tenth of the amplitude: noise", amplitude=0.1),
    "large": Condition("six times the amplitude: a third of the gap", amplitude=6.0),
    "saturating": Condition("the same with iron that saturates", amplitude=6.0, effects={"saturation": {"field": 0.6}}),
    "hysteresis": Condition("hysteresis of the iron", effects={"hysteresis": {"strength": 0.2, "width": 0.05}}),
    "friction": Condition(
        "a rubbing cable", effects={"friction": {"force": 0.02, "velocity": 1e-3, "presliding": 0.0}}
    ),
    "injection": Condition("the injection alone, current recorded", places=("current",), hidden=("force",)),
    "command": Condition("the injection alone, command recorded", places=("current",), hidden=("force", "current")),
}
