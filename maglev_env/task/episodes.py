"""Episodes: a rig drawn around the nominal one, a target, and the starting point of tuning."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.evaluation.score import ScoreTarget
from maglev_env.loop.gains import of_axis
from maglev_env.rig.drawn import scaled_rig, tolerance_factors
from maglev_env.rig.rig import Rig
from maglev_env.task.gain_box import GainBox

RANDOMIZATIONS = ("none", "tolerances", "wide")
WIDE = (0.75, 1.35)  # range of the factors of "wide" for a rig without [randomization]
TARGET_RANGE = (0.8, 1.5)  # range of the ratio of a drawn target to the nominal one
START = 0.5  # weight of a random point in the starting point of tuning; the rest is the preset


@dataclass(frozen=True, eq=False)
class Episode:
    """One drawn tuning problem.

    Args:
        rig: drawn around the nominal one.
        target: of the score.
        start: the first action, (k,) in [-1, 1].
        seed: of the noise of its experiments.
    """

    rig: Rig
    target: ScoreTarget
    start: np.ndarray
    seed: int


def check_randomization(rig: Rig, randomization: str) -> None:
    """Raise ValueError if the name is unknown, or the rig gives no ranges to draw from."""
    if randomization not in RANDOMIZATIONS:
        raise ValueError(f"randomization = {randomization!r}; use one of {', '.join(RANDOMIZATIONS)}")
    if randomization == "tolerances" and not rig.tolerance:
        raise ValueError(f"randomization = 'tolerances': rig {rig.name} has no [tolerance]")
    if randomization == "wide" and not wide_factors(rig):
        raise ValueError(f"randomization = 'wide': rig {rig.name} has neither [randomization] nor [tolerance]")


def wide_factors(rig: Rig) -> Mapping[str, tuple[float, float]]:
    """Ranges (low, high) from which "wide" draws factors log-uniformly, by parameter.

    They are the rig's [randomization]; without it, WIDE for every parameter that has a tolerance.
    """
    return rig.randomization or {name: WIDE for name in rig.tolerance if getattr(rig, name) is not None}


def log_spread(ends: tuple[float, float]) -> float:
    """Standard deviation of the logarithm of a factor that is drawn log-uniformly between two ends."""
    return float(np.log(ends[1] / ends[0]) / np.sqrt(12))


def draw_episode(
    rig: Rig, target: ScoreTarget, box: GainBox, randomization: str, draw_target: bool, rng: np.random.Generator
) -> Episode:
    """Draw one episode; all random numbers come from rng, in a fixed order.

    Args:
        rig: the nominal rig, with gains.
        target: the nominal target.
        box: of the gains to tune.
        randomization: one of RANDOMIZATIONS.
        draw_target: whether stiffness and damping of the target are drawn too.
        rng: source of all random numbers.
    """
    factors: Mapping[str, float] = {}
    if randomization == "tolerances":
        factors = tolerance_factors(rig, rng)
    elif randomization == "wide":
        ends = {name: np.log(pair) for name, pair in wide_factors(rig).items()}
        factors = {name: float(np.exp(rng.uniform(*pair))) for name, pair in ends.items()}
    drawn = scaled_rig(rig, factors)
    if draw_target:
        stiffness, damping = np.exp(rng.uniform(*np.log(TARGET_RANGE), size=2))
        target = replace(target, stiffness=target.stiffness * stiffness, damping=target.damping * damping)
    preset = box.point(of_axis(rig.gains, 0))
    start = START * rng.uniform(-1.0, 1.0, size=len(box.names)) + (1 - START) * preset
    return Episode(drawn, target, start, int(rng.integers(2**63)))
