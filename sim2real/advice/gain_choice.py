"""Effect of a gap on tuning: how similarly two simulators rank gains, and what choosing by the wrong one costs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import spearmanr

from maglev_env.evaluation.evaluate import evaluate
from maglev_env.experiment import protocol_experiment
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.gains import Controllers, PidGains
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import Rig
from sim2real.compared.point import Point, experiment_at

FACTORS = tuple((kp, kd) for kp in (0.7, 1.0, 1.4) for kd in (0.7, 1.0, 1.4, 2.0))  # factors on the rig's kp and kd


@dataclass(frozen=True)
class GainChoice:
    """Scores, 0 to 1, of all gain sets in FACTORS on the nominal and on the corrected simulator."""

    nominal: np.ndarray
    corrected: np.ndarray

    @property
    def rank_correlation(self) -> float | None:
        """Spearman's rank correlation; None where either simulator gives all sets the same score."""
        if np.ptp(self.nominal) == 0 or np.ptp(self.corrected) == 0:
            return None
        return float(spearmanr(self.nominal, self.corrected).statistic)

    @property
    def regret(self) -> float:
        """Score lost by choosing on the nominal simulator, judged by the corrected simulator."""
        return float(self.corrected.max() - self.corrected[np.argmax(self.nominal)])

    @property
    def chosen(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Factors on kp and kd that the nominal and the corrected simulator choose."""
        return FACTORS[int(np.argmax(self.nominal))], FACTORS[int(np.argmax(self.corrected))]


def gain_sets(gains: Controllers) -> list[Controllers]:
    """Controllers with every one of FACTORS on kp and kd.

    Raises:
        ValueError: The controllers are not PID.
    """
    axes = gains if isinstance(gains, tuple) else (gains,)
    if not all(isinstance(g, PidGains) for g in axes):
        raise ValueError("gain sets need PID gains; the recording has another controller")
    sets = [tuple(replace(g, kp=kp * g.kp, kd=kd * g.kd) for g in axes) for kp, kd in FACTORS]
    return sets if isinstance(gains, tuple) else [one for (one,) in sets]


def gain_choice(rig: Rig, corrected: Point, speed_rpm: float = 0.0) -> GainChoice | None:
    """Scores of the gain sets on both simulators.

    None where the rig has no PID gains, they do not stabilise it, or its protocol cannot score them.
    """
    gains: Sequence[object] = rig.gains if isinstance(rig.gains, tuple) else (rig.gains,)
    driven = rig.protocol is not None and all(
        lines_at(rig.protocol.excitations, at).size for at in ("force", "current")
    )
    if not driven or not all(isinstance(g, PidGains) for g in gains):
        return None
    if abs(closed_loop_poles(replace(protocol_experiment(rig, rig.gains), speed_rpm=speed_rpm))).max() >= 1:
        return None
    planned = [replace(protocol_experiment(rig, one), speed_rpm=speed_rpm) for one in gain_sets(rig.gains)]
    both = (evaluate(p).score for p in (planned, [experiment_at(e, corrected) for e in planned]))
    return GainChoice(*map(np.asarray, both))
