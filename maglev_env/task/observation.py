"""The observation: the result of one identification experiment as numbers in [-1, 1]."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from maglev_env.evaluation.evaluation import Evaluation
from maglev_env.evaluation.goal_score import misses
from maglev_env.evaluation.score import ScoreTarget
from maglev_env.rig.goal import Goal

BANDS = 5
# Margins, each scaled from bad (-1) to good (1); a crossing outside the measured lines counts as a good margin.
MARGINS = ("peak_sensitivity", "gain_margin_high", "phase_margin", "disk_margin")


@dataclass(frozen=True, eq=False)
class Layout:
    """The elements of an observation.

    Args:
        bands: (b, 2), Hz.
        gains: names of the gains that are tuned.
        nominal: nominal target, by which stiffness and damping are scaled.
        budget: number of experiments in an episode.
        drawn_target: whether the target is part of the observation.
        goal: whose quantities are part of the observation; None for `match`.
    """

    bands: np.ndarray
    gains: tuple[str, ...]
    nominal: ScoreTarget
    budget: int
    drawn_target: bool
    goal: Goal | None = None

    TARGET: ClassVar = ("target_stiffness", "target_damping")

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each element, in order."""
        per_band = [
            f"{name}_{low:.0f}_{high:.0f}_hz"
            for name in ("stiffness", "damping", "stiffness_se", "damping_se")
            for low, high in self.bands
        ]
        target = self.TARGET if self.drawn_target else ()
        ratios = ("stiffness_over_target", "damping_over_target")
        of_goal = [f"reserve_{r.name}" for r in self.goal.measured] if self.goal else []
        head = (*per_band, *ratios, *MARGINS, "displacement", "current", *self.gains, "experiments_left", *target)
        return (*head, *of_goal)

    def encode(
        self, e: Evaluation, targets: ScoreTarget, actions: np.ndarray, experiments_left: np.ndarray
    ) -> np.ndarray:
        """Observations of n experiments.

        After a touchdown the estimates are 0, their standard errors and the levels 1, and the margins -1.

        Args:
            e: results of the experiments.
            targets: with arrays (n,).
            actions: (n, k).
            experiments_left: (n,).

        Returns:
            (n, len(names)), float32.
        """
        n, k, c = len(e.score), self.nominal.stiffness, self.nominal.damping
        down = ~np.isnan(e.touchdown_time)
        estimates = [_signed(e.band_stiffness / k), _signed(e.band_damping / c)]
        errors = [decades(e.band_stiffness_se / k, -4, 1), decades(e.band_damping_se / c, -4, 1)]
        ratios = np.stack([ratio(e.stiffness / targets.stiffness), ratio(e.damping / targets.damping)], axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            peak = 1 - 2 * np.log(e.margins["peak_sensitivity"]) / np.log(20.0)
            room = [
                2 * np.log(e.margins["gain_margin_high"]) / np.log(20.0) - 1,
                2 * e.margins["phase_margin"] / 90.0 - 1,
                2 * e.margins["disk_margin"] - 1,
            ]
        margins = np.stack([_filled(peak, -1.0), *(_filled(m, 1.0) for m in room)], axis=1)
        margins[down] = -1.0
        levels = [decades(e.peak_displacement / targets.clearance, -3, 0)]
        levels += [decades(e.current_rms / targets.current_limit, -3, 1)]
        left = 2 * experiments_left / self.budget - 1
        parts = [*estimates, *errors, ratios, margins, np.stack(levels, axis=1), actions, left[:, None]]
        if self.drawn_target:
            parts.append(self.of_target(targets))
        for one in self.goal.measured if self.goal else ():
            parts.append(np.where(down, -1.0, -misses(one, e.required[one.name]) / np.log(5.0))[:, None])
        return np.clip(np.concatenate(parts, axis=1).reshape(n, -1), -1.0, 1.0).astype(np.float32)

    def of_target(self, targets: ScoreTarget) -> np.ndarray:
        """The elements (n, 2) of the targets, which hold arrays (n,)."""
        stiffness, damping = (
            ratio(targets.stiffness / self.nominal.stiffness),
            ratio(targets.damping / self.nominal.damping),
        )
        return np.stack([stiffness, damping], axis=1)


def _filled(x: np.ndarray, value: float) -> np.ndarray:
    return np.where(np.isfinite(x), x, value)


def _signed(x: np.ndarray) -> np.ndarray:
    """Signed logarithmic scale: 0 at 0, about a half at 1, 1 at 20; 0 for unknown values."""
    return _filled(np.arcsinh(10 * x) / np.arcsinh(200.0), 0.0)


def decades(x: np.ndarray, low: float, high: float) -> np.ndarray:
    """Logarithmic scale: -1 at 10^low, 1 at 10^high; 1 for unknown values."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return _filled(2 * (np.log10(x) - low) / (high - low) - 1, 1.0)


def ratio(x: np.ndarray) -> np.ndarray:
    """Logarithm of a ratio: 0 at the target, +-1 at a factor of five; -1 if not positive, 0 for unknown values."""
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = np.log(np.where(x > 0, x, np.nan)) / np.log(5.0)
    return np.where(np.isnan(x), 0.0, np.where(x > 0, scaled, -1.0))
