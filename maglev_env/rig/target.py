"""What a rig states in [target]: the values and the goal that gains are scored by."""

from dataclasses import dataclass
from math import inf

from maglev_env.fields import is_number
from maglev_env.rig.goal import MATCH, check_goal

LOWEST_BAND = 4.0  # Hz, below which an octave holds too few of the lines, 1 Hz apart, of a default protocol


@dataclass(frozen=True)
class Target:
    """Targets of the score.

    Args:
        band: (low, high) in Hz, in which stiffness and damping are compared; a rig replaces None by `default_band`.
        stiffness: N/m; None: that of the preset gains.
        damping: N s/m; None: that of the preset gains.
        peak_sensitivity: largest acceptable one.
        current_limit: rms current at which the score's current term is a half, A.
        goal: what gains are scored by: "match" for the values above, "engineer", or requirements (see `rig.goal`).

    Raises:
        ValueError: A value is not a positive number, the band is none above 0 Hz, or the goal is not understood.
    """

    band: tuple[float, float] | None = None
    stiffness: float | None = None
    damping: float | None = None
    peak_sensitivity: float = 2.5
    current_limit: float = 1.0
    goal: str = MATCH

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping", "peak_sensitivity", "current_limit"):
            value = getattr(self, name)
            optional = name in ("stiffness", "damping") and getattr(self, name) is None
            if not optional and not (is_number(value) and value > 0):
                raise ValueError(f"[target]: {name} = {value!r} must be a number above 0")
        if self.band is not None and not 0 < self.band[0] < self.band[1]:
            raise ValueError(f"[target]: band = {list(self.band)} must be two increasing frequencies above 0 Hz")
        try:
            check_goal(self.goal)
        except ValueError as error:
            raise ValueError(f"[target]: {error}") from None


def default_band(control_rate: float, mode: float = inf) -> tuple[float, float]:
    """The target band of a rig that states none, Hz: an octave from 60 Hz, or from its loop's mode if that is lower.

    Far above the mode of the loop, what holds the rotor is a small part of its inertia force, and no experiment shows
    its stiffness.

    Args:
        control_rate: Hz; at rates to which 120 Hz folds back the band ends at a quarter of it.
        mode: frequency at which the loop is expected to swing, Hz; inf: not known.
    """
    at_rate = 60.0 if control_rate > 240.0 else control_rate / 8
    low = min(at_rate, max(LOWEST_BAND, float(f"{mode:.2g}")))
    return low, 2 * low
